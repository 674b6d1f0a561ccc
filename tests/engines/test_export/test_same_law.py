"""Laws that an engine has itself, exported as they are, and e at a time step.

Against the engines' rules for their forces and their schemes, written in NumPy.
"""

import math
import re

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import jaxcontact as jc
from jaxcontact.engines import export
from tests.engines.test_export import engines

STEPS = 2e-3  # the steps of the test, 2000 in a contact, of first order: measured 6e-4
FORCE = 1e-12  # formulas for one force: measured 3e-15

SPHERES = jc.Contact(mass=1e-11, stiffness=4e6)
SPRING = jc.Contact(mass=0.033, stiffness=1e7, exponent=1.0)
RADIUS = 1e-5
DMT = jc.DMT.of_surfaces(0.1, RADIUS)


def numbers(line):
    return [float(x) for x in re.findall(r"(?<= )[\d.]+(?:e[+-]?\d+)?|(?<=\()[\d.e+-]+", line)]


def test_dmt_in_lammps_has_the_force_of_its_documentation():
    found = export(DMT, SPHERES, 0.05, engine="lammps", radius=RADIUS)
    line = found.snippet.splitlines()[1].partition(" tangential")[0]
    young, damping, poisson, gamma = numbers(line)
    assert list(found.parameters.values()) == pytest.approx([young, damping, poisson, gamma])
    assert damping == 0
    assert gamma == pytest.approx(0.05)  # half of the work of adhesion
    modulus = young / (2 * (1 - poisson**2))
    for depth in (0.0, 3e-9, 4e-8):
        written = 4 / 3 * modulus * math.sqrt(RADIUS * depth) * depth - 4 * math.pi * gamma * RADIUS
        ours = float(found.law.force(depth, 0.0, found.contact, 0.05))
        assert ours == pytest.approx(written, rel=1e-10)
    assert found.target == found.delivered == 1
    assert found.at_time_step(found.time_step).high < 1 + found.expected_error
    everywhere = found.holds()
    assert (everywhere.low, everywhere.high) == (0, math.inf) and "nan" not in repr(everywhere)


def leapfrog(force, stiffness, speed):
    """Return e by the force at an overlap, the largest one so far, and the latter afterwards."""
    most, v = 0.0, speed
    h = math.pi * math.sqrt(float(SPRING.mass) / stiffness) / 2000
    x = v * h / 2
    while x > 0:
        push, most = force(x, most)
        v -= h * push / float(SPRING.mass)
        x += h * v
    return -v / speed


def mercurydpm(parameters, constant, radius, speed):
    """Return e of `LinearPlasticViscoelasticInteraction`, by its rule."""
    k1, k2max, kc, phi = parameters
    fluid = math.inf if k2max == k1 else k2max / (k2max - k1) * phi * 2 * radius

    def force(x, most):
        most = max(most, min(fluid, x))
        k2 = k2max if constant else k1 + (k2max - k1) * most / fluid
        push = k2 * (x - (k2 - k1) / k2 * most)
        return (push, most) if push >= -kc * x else (-kc * x, (k2 + kc) / (k2 - k1) * x)

    return leapfrog(force, k1, speed)


@pytest.mark.parametrize(
    "law",
    [
        jc.Luding(ratio=1.0, slope=3e3, adhesion=0.5),
        jc.Luding(ratio=1.5, slope=0.0, adhesion=0.5),
        jc.WaltonBraun(ratio=1.0, slope=3e3),
        jc.WaltonBraun(ratio=2.0, slope=0.0),
    ],
    ids=repr,
)
def test_mercurydpm_has_the_rule_of_its_source(law):
    speeds, radius = np.array([0.3, 1.0, 3.0]), 0.01
    found = export(law, SPRING, speeds, engine="mercurydpm", radius=radius)
    printed = numbers(found.snippet.replace(",", " ").partition("setPlasticParameters")[2])[:4]
    assert printed == pytest.approx(list(found.parameters.values()))
    # With a slope and φ = 1 the bound of k2 is an overlap of the whole sphere.
    constant = "doConstantUnloadingStiffness" in found.snippet
    assert constant == (float(law.slope) == 0)
    for speed, target in zip(speeds, found.target, strict=True):
        e = mercurydpm(printed, constant, radius, speed)
        assert e == pytest.approx(target, abs=STEPS)
    np.testing.assert_allclose(found.error, 0, atol=FORCE)
    assert found.time_step is None
    with pytest.raises(ValueError, match=r"'mercurydpm' with LinearPlastic.* it was not run"):
        found.at_time_step(1e-6)


def exudyn(p, speed):
    """Return e of impact model 0, by the three cases of its manual."""
    k, ratio, adhesion = (
        p[x] for x in ("contactStiffness", "contactPlasticityRatio", "adhesionCoefficient")
    )
    assert p["contactStiffnessExponent"] == p["adhesionExponent"] == 1

    def force(x, most):
        back = k / (1 - ratio) * (x - ratio * max(most, x))
        return max(min(k * x, back), -adhesion * x), max(most, x)

    return leapfrog(force, k, speed)


@pytest.mark.parametrize(
    "law",
    [jc.Luding(ratio=1.5, slope=0.0, adhesion=0.5), jc.WaltonBraun(ratio=20.0, slope=0.0)],
    ids=repr,
)
def test_exudyn_has_the_cases_of_its_manual(law):
    found = export(law, SPRING, 1.0, engine="exudyn")
    words = eval(f"dict({found.snippet})")
    assert (words.pop("impactModel"), words.pop("contactDamping")) == (0, 0)
    assert words == pytest.approx(dict(found.parameters))
    assert exudyn(words, 1.0) == pytest.approx(found.target, abs=STEPS)
    assert found.delivered == pytest.approx(found.target, abs=FORCE)
    # An impact model asked for matches the restitution, as for any other law.
    model = export(law, SPRING, 1.0, engine="exudyn", impact_model=2)
    assert "restitutionCoefficient" in model.parameters
    assert export(law, SPRING, 1.0, engine="exudyn", impact_model=0).snippet == found.snippet


def test_an_elastic_plastic_law_without_hysteresis():
    law = jc.Luding(ratio=jnp.asarray(1.0), slope=0.0, adhesion=0.5)
    found = export(law, SPRING, 1.0, engine="mercurydpm")
    assert found.parameters["unloadingStiffnessMax"] == found.parameters["loadingStiffness"]
    assert found.delivered == pytest.approx(1)


SCHEME = 2e-9
"""Of e: the scheme in NumPy and in JAX round otherwise, and an implicit step is halved 30 times."""

NEAR = 2e-3  # of e, between MuJoCo at 64 places within a step and the range over 256

CONTACT = jc.Contact(1.0, 85667.0476, 1.0)
LAW = jc.KelvinVoigt(e=0.6, tension=False)


def ends(acceleration, step, implicit):
    """The least and the largest rebound at 1 m/s over 256 places within a step."""
    left = []
    for phase in (np.arange(256) + 1) / 256:
        x, v = phase * step, 1.0
        while x > 0:
            if implicit:

                def beyond(later, x=x, v=v):
                    force = acceleration(max(x + step * later, 0), later, 1.0)
                    return later - v - step * min(force, 0)

                v = brentq(beyond, v - beyond(v), v, xtol=1e-15)
            else:
                v += step * min(acceleration(x, v, 1.0), 0)
            x += step * v
        left.append(-v)
    return min(left), max(left)


def test_mujoco_at_a_robots_step():
    found = jc.export(LAW, CONTACT, 1.0, engine="mujoco")
    assert found.duration == pytest.approx(9.65e-3, rel=1e-6)
    acceleration = engines.mujoco(found.parameters, 1.0, 0.1)
    # The result of MuJoCo 4.0.0 itself, by the snippet of the export.
    for step, itself in ((1e-3, (0.56676, 0.63294)), (2e-3, (0.54821, 0.69333))):
        at = found.at_time_step(step, within=0.02)
        assert (at.low, at.high) == pytest.approx(ends(acceleration, step, False), abs=SCHEME)
        assert (at.low, at.high) == pytest.approx(itself, abs=NEAR)
    # With proportionally shorter steps e is preserved.
    again = found.at_time_step(2e-3 * at.duration / at.needed, within=0.02)
    assert max(0.6 - again.low, again.high - 0.6) <= 0.02 and again.needed <= at.duration * 1.01
    assert "within 0.02 of the target 0.6 from a contact of " in str(at)


def test_drake_at_a_robots_step():
    found = jc.export(jc.ExactRestitution(e=0.6), CONTACT, 1.0, engine="drake")
    acceleration = engines.drake(found.parameters, 1.0, 0.1)
    step = found.duration / 40
    at = found.at_time_step(step)
    assert (at.low, at.high) == pytest.approx(ends(acceleration, step, True), abs=1e-7)
    # Implicit steps damp.
    assert at.high < at.target


def test_what_has_no_answer():
    for engine, words in (
        ("exudyn", "'newton' for a time step, but is 'exudyn' with .*; its error is known at"),
        ("bullet", "'newton' for a time step, but is 'bullet'"),
    ):
        with pytest.raises(ValueError, match=words):
            jc.export(LAW, CONTACT, 1.0, engine=engine).at_time_step(1e-3)


def test_the_engines_with_known_steps_are_named():
    with pytest.raises(ValueError, match="`engine` must be one of") as error:
        jc.export(LAW, CONTACT, 1.0, engine="adams").at_time_step(1e-3)
    for engine in ("bullet", "drake", "exudyn", "lammps", "mercurydpm", "mujoco", "newton", "yade"):
        options = {"radius": 0.1} if engine in ("lammps", "yade") else {}
        known = jc.export(LAW, CONTACT, 1.0, engine=engine, **options).scheme is not None
        assert (f"'{engine}'" in str(error.value)) == known

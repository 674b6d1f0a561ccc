"""e at a time step, against the engines' schemes written in NumPy."""

import numpy as np
import pytest
from scipy.optimize import brentq

import jaxcontact as jc
from tests.engines.test_export import engines

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

"""Single impacts of contacts that unload along another curve than they load."""

import functools

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._laws.yielding import YieldingForm
from tests.oracle.plastic_chain import follow, thornton, walton_braun
from tests.oracle.stored import stored
from tests.test_impact.support import assert_same, assert_slopes, impacts, slopes_of_lanes

FORMULA = 3e-15  # relative error of e, x_m and F: measured 7e-16
QUADRATURE = 1e-12
"""The same of times down to v_y/v0 = 1e-4: measured 9e-14 in the difference of two phases."""
BY_SCIPY = 3e-10  # beside an integration at rtol 1e-12: measured 4e-11
STEPS = 1e-10  # of event solves at rtol 1e-11: measured 3e-12 in e, 1e-11 in times
BALANCE = 1e-10  # of the energies along a solve at rtol 1e-11: measured 2e-12
SLOPES = 1e-6  # central differences with h = 1e-6: measured 2e-9, 3e-8 near yield

HERTZ = jc.Contact(mass=0.3, stiffness=2e8, exponent=1.5)
SPRING = jc.Contact(mass=0.3, stiffness=2e6, exponent=1.0)
LAWS = {
    "thornton": (jc.ThorntonPlastic(yield_speed=0.1), HERTZ, thornton(0.3, 2e8, 0.1)),
    "elastic": (jc.ThorntonPlastic(yield_speed=3.0), HERTZ, thornton(0.3, 2e8, 3.0)),
    "viscoplastic": (jc.Viscoplastic(yield_speed=0.2, c=3e7), HERTZ, thornton(0.3, 2e8, 0.2, 3e7)),
    "walton_braun": (jc.WaltonBraun(ratio=1.3, slope=4e2), SPRING, walton_braun(2e6, 1.3, 4e2)),
}
NUMBERS = ["restitution", "duration", "compression_time", "max_indentation", "max_force"]


@stored()
@mp.workdps(30)
def by_energy(r, alpha):
    """Every number of a viscoplastic impact in 30 digits, in units of x'' = -f, v0 = 1."""
    r, alpha = mp.mpf(r), mp.mpf(alpha)
    y = (mp.mpf(5) / 4 * r**2) ** mp.mpf("0.4")
    root = mp.sqrt(y)

    def work(x):
        d = max(x - y, 0)
        return mp.mpf(2) / 5 * min(x, y) ** 2.5 + root * d * (y + 3 * d / 4)

    def force(energy):
        """The force after a work: F² grows with it beyond yield."""
        if energy <= work(y):
            return (mp.mpf(5) / 2 * max(energy, 0)) ** mp.mpf("0.6")
        return mp.sqrt(y**3 + 3 * root * (energy - work(y)))

    def kinetic(v):
        return v * v / 2 if alpha == 0 else v / alpha - mp.log1p(alpha * v) / alpha**2

    most = kinetic(1)
    strongest = force(most)
    deepest = mp.findroot(lambda x: work(x) - most, 1)
    back = strongest / mp.sqrt(deepest)
    stored = mp.mpf(2) / 5 * strongest * back
    # From below 1/α, where a rebound would take for ever.
    high = 1 if alpha == 0 else min(1, (1 - mp.mpf(10) ** -25) / alpha)
    e = mp.findroot(
        lambda s: kinetic(-s) - stored, (mp.mpf("1e-9"), high), solver="anderson", tol=1e-50
    )
    flatter = mp.sqrt(deepest**1.5 / strongest)

    def slowness(v, pushes):
        push = pushes(v)
        return 1 / (push * (1 + alpha * v)) if push > 0 else mp.mpf(0)

    def loads(v):
        return force(most - kinetic(v))

    def unloads(v):
        left = mp.mpf(5) / 2 * max(stored - kinetic(v), 0)
        return flatter ** mp.mpf("0.4") * left ** mp.mpf("0.6")

    # Powers of the way to each end, where slowness has a root or a pole.
    slow = mp.mpf(0)
    if deepest > y:
        slow = mp.findroot(
            lambda v: most - kinetic(v) - work(y), (0, 1), solver="anderson", tol=1e-50
        )
    first, power = 1 - slow, mp.mpf(5) / 2
    way_in = mp.quad(
        lambda q: slowness(1 - first * q**power, loads) * first * power * q**1.5, [0, 0.5, 1]
    ) + mp.quad(lambda s: slowness(slow * (1 - s * s), loads) * 2 * s * slow, [0, 0.01, 0.1, 1])
    way_out = mp.quad(
        lambda q: slowness(-e * (1 - q**power), unloads) * e * power * q**1.5, [0, 0.1, 0.5, 1]
    )
    numbers = e, way_in + way_out, way_in, deepest, strongest, deepest - back
    return np.array([float(x) for x in numbers])


@pytest.mark.parametrize(
    ("r", "alpha"),
    [([1e-4, 0.3, 0.999, 1.5], None), ([0.03, 0.2], [1.0, 20.0])],
    ids=["undamped", "damped"],
)
def test_formulas_and_quadratures(r, alpha):
    pairs = zip(r, alpha or [0.0] * len(r), strict=True)
    expected = np.transpose([by_energy(*pair) for pair in pairs])
    roots = (1.25 * np.square(r)) ** 0.2
    damping = None if alpha is None else np.array(alpha)
    solve = jax.jit(lambda root, alpha: YieldingForm(root=root, alpha=alpha).solve(1.5))
    found = solve(roots, damping)
    times = [found.duration, found.compression_time]
    np.testing.assert_allclose(found.restitution, expected[0], rtol=FORMULA)
    np.testing.assert_allclose(times, expected[1:3], rtol=QUADRATURE)
    np.testing.assert_allclose(found.max_indentation, expected[3], rtol=FORMULA)
    if alpha is None:
        np.testing.assert_allclose(found.max_force, expected[4], rtol=FORMULA)
    np.testing.assert_allclose(found.end_indentation, expected[5], atol=FORMULA)


def test_the_published_formula_and_its_limit():
    """Thornton (1997); with r = v_y/v → 0 his e is 1.18499 r^(1/4).

    With Johnson's constant of fully plastic spheres see test_elastic_plastic.
    """
    r = np.array([1e-9, 1e-3, 0.3, 0.999])
    plastic = np.sqrt(6 * np.sqrt(3) / 5 * (1 - r**2 / 6))
    published = plastic * (r / (r + 2 * np.sqrt((6 - r**2) / 5))) ** 0.25
    law = jc.ThorntonPlastic(yield_speed=0.1)
    for found in (jc.restitution(law, velocity=0.1 / r), law.restitution_at(0.1 / r)):
        np.testing.assert_allclose(found, published, rtol=FORMULA)
    assert published[0] / r[0] ** 0.25 == pytest.approx(1.18499, abs=5e-6)


@functools.cache
def solved(name, method):
    law, contact, _ = LAWS[name]
    how = jc.Event(rtol=1e-11) if method == "event" else method
    return impacts(law, contact, 2.0, method=how)


@functools.cache
def followed(name):
    law, contact, _ = LAWS[name]
    return jc.trajectory(law, contact, 2.0, samples=50, method=jc.Event(rtol=1e-11))


@stored()
def of_a_pair(name, duration):
    """e, when the gap opens, and the largest force; both bodies have twice the effective mass."""
    found = follow([LAWS[name][2]], [0.6, 0.6], [0.0], [1.0, -1.0], 3 * duration)
    return (found.velocity[1] - found.velocity[0]) / 2, found.opening[0], found.strongest[0]


@pytest.mark.parametrize("name", LAWS)
def test_impacts_beside_scipy_and_by_steps(name):
    """A free impact, from touch to the end of its force, where the bodies are still indented."""
    hit = solved(name, "exact")
    e, opening, strongest = of_a_pair(name, float(hit.duration))
    np.testing.assert_allclose(hit.restitution, e, rtol=BY_SCIPY)
    np.testing.assert_allclose(hit.energy_loss, 0.6 * (1 - e**2), atol=BY_SCIPY)
    if name != "viscoplastic":
        np.testing.assert_allclose(hit.max_force, strongest, rtol=BY_SCIPY)
    end, after = followed(name).indentation[-1], opening - hit.duration
    np.testing.assert_allclose(after * hit.rebound_velocity, end, atol=1e-8 * hit.max_indentation)
    by_steps = solved(name, "event")
    assert_same(by_steps, hit, NUMBERS, rtol=STEPS)
    assert_same(by_steps, hit, ["energy_loss"], rtol=0, atol=0.6 * STEPS)


@pytest.mark.parametrize("name", LAWS)
def test_energies_along_an_impact(name):
    """What is stored, what the contact keeps and what damping takes add up at each moment."""
    (law, contact, _), path, hit = LAWS[name], followed(name), solved(name, "exact")
    np.testing.assert_allclose(path.energy.total, 0.6, rtol=BALANCE)
    assert np.all(np.diff(path.energy.dissipated) > -BALANCE)
    np.testing.assert_allclose(path.energy.dissipated[-1], hit.energy_loss, atol=BALANCE)
    # The force at each moment is that of the law with the memory of that moment.
    largest = np.maximum.accumulate(path.indentation)
    largest[path.velocity < 0] = hit.max_indentation
    force = law.force(path.indentation, path.velocity, contact, 2.0, largest)
    np.testing.assert_allclose(path.force, force, atol=1e-8 * np.max(path.force))


def test_a_bilinear_contact_has_a_constant_e_or_one_that_falls():
    speeds = np.array([0.01, 1.0, 30.0])
    fixed = impacts(jc.WaltonBraun(ratio=4.0, slope=0.0), SPRING, speeds)
    np.testing.assert_allclose(fixed.restitution, 0.5, rtol=FORMULA)
    falls = jc.restitution(jc.WaltonBraun(ratio=1.0, slope=1e3), SPRING, speeds)
    # Walton and Braun's e = √(ω/(ω + S v0)).
    frequency = np.sqrt(2e6 / 0.3)
    np.testing.assert_allclose(falls, np.sqrt(frequency / (frequency + 1e3 * speeds)), rtol=1e-14)


def test_derivatives_in_both_modes():
    """Of all numbers by speed, yield speed and damping; also of a contact that does not yield."""

    def numbers(given):
        speed, yields, c = given
        hit = jc.impact(jc.Viscoplastic(yield_speed=yields, c=c), HERTZ, speed)
        return jnp.stack([getattr(hit, name) for name in NUMBERS])

    starts = [[2.0, 0.2, 3e7], [1.0, 0.99, 1e7], [1.0, 1.5, 1e7]]
    solve = slopes_of_lanes(numbers)
    _, forward = assert_slopes(solve, starts, 1e-6, SLOPES, rtol=1e-10, atol=1e-13)
    assert np.all(forward[2, :, 1] == 0)


@stored()
def opening(force, c):
    """When the gap opens of a body that meets a wall with 0.5 m/s under a force."""
    start = [thornton(0.3, 2e8, 0.1, c)], [0.3, 1e30], [0.0], [0.5, 0.0]
    return float(follow(*start, 0.01, lambda t: np.array([force / 0.3, 0.0])).opening[0])


def test_a_contact_under_load_stays_or_separates():
    """Under 300 N the force vanishes, but the bodies come back before the gap opens."""
    law, weight = jc.ThorntonPlastic(yield_speed=0.1), np.array([-30.0, 30.0, 300.0, 3000.0])
    hit = impacts(law, HERTZ, 0.5, external_force=weight)
    opens = [opening(force, 0.0) for force in weight.tolist()]
    np.testing.assert_array_equal(hit.status, np.isnan(opens))
    np.testing.assert_array_equal(hit.status, [0, 0, 1, 1])
    np.testing.assert_array_equal(hit.restitution[2:], 0)
    path = jc.trajectory(law, HERTZ, 0.5, external_force=weight, samples=30)
    np.testing.assert_array_equal(path.status, hit.status)
    assert np.all(np.diff(hit.max_indentation) > 0)
    # The work of the push until separation is part of the balance.
    np.testing.assert_allclose(path.energy.total[:2], 0.0375, rtol=1e-8)
    np.testing.assert_allclose(-path.velocity[:2, -1] / 0.5, hit.restitution[:2], rtol=1e-8)


def test_strong_damping_under_a_pull():
    """The pull makes the bodies faster than K/c, where the force vanishes above x_p."""
    law, pull = jc.Viscoplastic(yield_speed=0.1, c=2e9), np.array([-100.0, -500.0, -2000.0])
    hit = impacts(law, HERTZ, 0.5, external_force=pull)
    ends = jc.trajectory(law, HERTZ, 0.5, external_force=pull, samples=2).indentation[:, -1]
    for k, force in enumerate(pull.tolist()):
        after = opening(force, 2e9) - hit.duration[k]
        coasts = hit.rebound_velocity[k] * after - force / 0.6 * after**2
        np.testing.assert_allclose(coasts, ends[k], atol=1e-8 * hit.max_indentation[k])
    np.testing.assert_allclose(hit.rebound_velocity, 2e8 / 2e9, rtol=1e-9)
    # A pull within the rounding of the force has no moment at which it ends the contact.
    weak, law = np.array([-1e-9, -2e-9, -100.0]), jc.Viscoplastic(yield_speed=0.1, c=2e10)
    hit = impacts(law, HERTZ, 0.5, external_force=weak)
    np.testing.assert_array_equal(hit.status, [2, 2, 0])

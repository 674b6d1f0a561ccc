"""Luding's contact, by formula beside an integration from event to event."""

import jax.numpy as jnp
import mpmath as mp
import numpy as np

import jaxcontact as jc
from tests.oracle.luding_chain import Powder, follow
from tests.oracle.stored import stored
from tests.test_impact.support import assert_same, assert_slopes, impacts, slopes_of_lanes

FORMULA = 1e-14  # beside an integration at 40 digits: measured 1e-15
SLOPES = 1e-8  # central differences with h = 1e-5: measured 2e-10
BY_EVENT = 1e-7  # of event solves at their default: measured 3e-10; the force has a corner at δ_min

SPRING = jc.Contact(mass=0.3, stiffness=2e6, exponent=1.0)
NUMBERS = ["restitution", "duration", "compression_time", "max_indentation", "max_force"]
NUMBERS += ["min_force"]
# Ratios of stiffness and adhesion: usual, elastic, without adhesion, strong, close to sticking.
CASES = [(1.5, 0.3), (1.0, 0.7), (4.0, 0.0), (1.2, 20.0), (3.0, 0.5), (3.0, 0.999), (30.0, 0.03)]


def part(rate, centre, state, watch, guess):
    """The motion x'' = -rate (x - centre) until `watch` of it is zero, by Taylor's series."""
    path = mp.odefun(lambda _, y: [y[1], -rate * (y[0] - centre)], 0, state)
    end = mp.findroot(lambda t: watch(*path(t)), guess)
    return end, path(end)


@stored()
def followed(factor, adhesion):
    """The numbers of an impact in units of x'' = -f, v0 = 1, from event to event."""
    with mp.workdps(40):
        k, c = (mp.mpf(repr(x)) for x in (factor, adhesion))
        turn, state = part(1, 0, [mp.mpf(0), mp.mpf(1)], lambda x, v: v, 1.5)
        most = state[0]
        end = most * (1 - 1 / k)
        # Where the way back meets -cx; an elastic one meets it at x = 0.
        back, state = part(
            k, end, [most, mp.mpf(0)], lambda x, v: k * (x - end) + c * x, 1.5 / mp.sqrt(k)
        )
        pull = c * state[0]
        last = mp.mpf(0)
        if k > 1:
            last, state = part(-c, 0, state, lambda x, v: x, -state[0] / state[1])
        return [float(x) for x in (-state[1], turn + back + last, turn, most, most, -pull)]


def scaled(hit, speed):
    frequency = np.sqrt(2e6 / 0.3)
    length = speed / frequency
    units = [1, 1 / frequency, 1 / frequency, length, 2e6 * length, 2e6 * length]
    found = [getattr(hit, name) for name in NUMBERS]
    return np.stack([np.asarray(x) / unit for x, unit in zip(found, units, strict=True)], axis=-1)


def test_impacts_from_event_to_event():
    ratio, adhesion = np.transpose(CASES)
    law = jc.Luding(ratio=ratio, slope=0.0, adhesion=adhesion)
    hit, faster = (impacts(law, SPRING, speed) for speed in (0.7, 7.0))
    expected = [followed(*case) for case in CASES]
    np.testing.assert_allclose(scaled(hit, 0.7), expected, rtol=FORMULA, atol=1e-30)
    energy = 0.3 * 0.7**2 / 2
    np.testing.assert_allclose(hit.energy_loss, energy * (1 - hit.restitution**2), atol=1e-15)
    # Without slope e does not depend on the speed.
    np.testing.assert_array_equal(faster.restitution, hit.restitution)


def test_a_slope_makes_the_way_back_stiffer():
    length = 0.7 * np.sqrt(0.3 / 2e6)
    hit = impacts(jc.Luding(ratio=1.5, slope=1.5 / length, adhesion=0.5), SPRING, 0.7)
    np.testing.assert_allclose(scaled(hit, 0.7), followed(3.0, 0.5), rtol=FORMULA)
    # Without adhesion it is Walton and Braun's contact, followed until δ = 0.
    plastic = impacts(jc.WaltonBraun(ratio=1.2, slope=200.0), SPRING, 0.7)
    hit = impacts(jc.Luding(ratio=1.2, slope=200.0, adhesion=0.0), SPRING, 0.7)
    np.testing.assert_allclose(hit.restitution, plastic.restitution, rtol=FORMULA)
    # The way from δ_p at the rebound velocity.
    factor = 1.2 + 200 * length
    glide = length * (1 - 1 / factor) / hit.rebound_velocity
    np.testing.assert_allclose(hit.duration, plastic.duration + glide, rtol=FORMULA)


def test_bodies_stick_from_a_ratio_on():
    """η (κ - 2) ≥ 1; the pull at δ_min is reached if the way back has the energy."""
    ratio = np.array([3.999, 4.0, 4.001, 40.0, 1e6])
    law = jc.Luding(ratio=ratio, slope=0.0, adhesion=0.5)
    hit = impacts(law, SPRING, 0.7)
    np.testing.assert_array_equal(hit.status, [0, 1, 1, 1, 1])
    np.testing.assert_array_equal(jc.restitution(law, SPRING, 0.7) > 0, [True] + [False] * 4)
    np.testing.assert_array_equal(hit.duration[1:], np.inf)
    # The energy that unloading returns is 1/(2κ), and the stiff spring takes it up to a pull of 1.
    pulls = np.minimum(0.5 * (ratio - 1) / (ratio + 0.5), 1)
    np.testing.assert_allclose(scaled(hit, 0.7)[:, -1], -pulls, rtol=FORMULA)
    strong = impacts(jc.Luding(ratio=5.0, slope=0.0, adhesion=10.0), SPRING, 0.7)
    np.testing.assert_allclose(scaled(strong, 0.7)[-1], -1, rtol=FORMULA)


def test_the_force_of_each_part():
    law = jc.Luding(ratio=1.5, slope=500.0, adhesion=0.4)
    most, factor = 1e-3, 2.0
    end, least = most * (1 - 1 / factor), most * (factor - 1) / (factor + 0.4)
    depth = np.array([-1e-4, 0.0, 1e-4, least, end, 9e-4, most, 2e-3])
    force = law.force(depth, 0.0, SPRING, 1.0, largest=most)
    expected = [0, 0, -0.4e-4, -0.4 * least, 0, 2 * (9e-4 - end), most, 2e-3]
    np.testing.assert_allclose(force, 2e6 * np.array(expected), rtol=FORMULA, atol=1e-12)
    np.testing.assert_allclose(
        law.force(depth, 0.0, SPRING, 1.0), 2e6 * np.maximum(depth, 0), rtol=FORMULA
    )


def test_derivatives_in_both_modes():
    def numbers(given):
        ratio, slope, adhesion, speed = given
        law = jc.Luding(ratio=ratio, slope=slope, adhesion=adhesion)
        hit = jc.impact(law, SPRING, speed)
        return jnp.stack([getattr(hit, name) for name in NUMBERS])

    solve = slopes_of_lanes(numbers)
    at = [[1.5, 30.0, 0.3, 0.7], [3.0, 30.0, 0.5, 0.7], [3.0, 9.0, 3e-3, 2.0]]
    assert_slopes(solve, at, 1e-5, SLOPES, rtol=1e-11, atol=1e-18)
    # At the edges: elastic, without adhesion, and bodies that stick.
    _, edges, _ = solve([[1.0, 0.0, 0.3, 0.7], [2.0, 0.0, 0.0, 0.7], [9.0, 0.0, 1.0, 0.7]])
    assert np.all(np.isfinite(edges))
    np.testing.assert_allclose(edges[0, 0, 0], -(1 + 0.3) / (1 + 0.3) / 2, rtol=FORMULA)
    np.testing.assert_array_equal(edges[2, :2], 0)


def test_the_event_solve_beside_the_formulas():
    ratio = np.array([1.5, 3.0, 6.0])
    law = jc.Luding(ratio=ratio, slope=30.0, adhesion=0.5)
    by_formula, by_event = (impacts(law, SPRING, 0.7, method=m) for m in ("auto", "event"))
    np.testing.assert_array_equal(by_event.status, [0, 0, 1])
    assert_same(by_event, by_formula, [*NUMBERS, "energy_loss"], at=np.s_[:2], rtol=BY_EVENT)
    path = jc.trajectory(law, SPRING, 0.7, samples=9)
    np.testing.assert_array_equal(path.status, by_event.status)
    total = np.asarray(path.energy.total)
    np.testing.assert_allclose(total / total[:, :1], 1, rtol=1e-8)
    np.testing.assert_allclose(path.time[:2, -1], by_formula.duration[:2], rtol=BY_EVENT)


@stored()
def velocity_after(push, speed, ratio):
    """Of a body that met a wall, 20 ms after touch; None if it is held."""
    found = follow(
        [Powder(1e5, ratio, 0.0, 0.5)], [0.5, 1e30], [0.0], [speed, 0.0], 0.02,
        lambda t: np.array([push / 0.5, 0.0]),
    )  # fmt: skip
    return float(found.velocity[0]) if found.openings > 0 else None


def test_pushes_and_pulls():
    """Beside SciPy; a pull below the adhesion at δ_min holds slow bodies."""
    spring, push = jc.Contact(0.5, 1e5, 1.0), np.array([3.0, -2.0, -10.0, 3.0, -0.1])
    speed, ratio = np.array([0.05, 0.05, 0.05, 1.0, 0.05]), np.array([3.0, 3.0, 3.0, 3.0, 6.0])
    law = jc.Luding(ratio=ratio, slope=0.0, adhesion=0.5)
    hit = impacts(law, spring, speed, external_force=push)
    after = list(map(velocity_after, push.tolist(), speed.tolist(), ratio.tolist()))
    np.testing.assert_array_equal(hit.status != 0, [x is None for x in after])
    # Afterwards the push alone acts.
    away = -hit.rebound_velocity + push / 0.5 * (0.02 - hit.duration)
    parts = hit.status == 0
    np.testing.assert_allclose(away[parts], np.array(after, float)[parts], rtol=BY_EVENT)

"""A push or a pull during contact: separation later, earlier, or never.

Energy: never gained, loss accurate to many digits, and the signature of a missed event.
"""

import itertools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import mp, mpf
from scipy.integrate import solve_ivp

import jaxcontact as jc
from jaxcontact._impact.motion import errors
from jaxcontact._impact.motion.ends import Verdict
from tests import oracle
from tests.oracle import FIELDS
from tests.oracle.stored import stored
from tests.test_impact.support import (
    DAMPING,
    UNIT,
    assert_within,
    both_jacobians,
    column,
    errors_of,
    given_ratio,
    grid,
    impacts,
    lanes,
)

# At the default rtol of 1e-9: measured 3.3e-9 (n = 3/2), 7.5e-9 (n = 1), twice that for the loss.
PROMISE, LOSS = 1e-8, 2e-8
BY_SCIPY = 1e-8  # measured 2e-9
# At rtol 1e-11, relative to the slope or 1e-3: measured 3.6e-7 where de/dΓ is small, else 1e-9.
SLOPE = 1e-6

FLAT = 1e-11  # of a duration: measured 7e-13


@pytest.mark.parametrize("n", [1.5, 1.0])
def test_against_the_oracle(n):
    some = grid("with_gravity", n=n)
    law, push = jc.Damped(alpha=column(some, "alpha")), column(some, "gamma")
    hit = impacts(law, UNIT[n], external_force=push)
    settled = np.array([c.settled for c in some])
    assert settled.sum() == 1
    assert (hit.status == np.where(settled, jc.Status.SETTLED, jc.Status.SEPARATED)).all()
    assert hit.method == "event"
    error = errors_of(hit, some)
    # For a contact that settles the oracle's duration is the time of its second turn.
    assert np.isinf(hit.duration[settled]).all()
    error["duration"] = np.where(settled, 0, error["duration"])
    tolerances = dict.fromkeys(error, PROMISE) | {"energy_loss": LOSS}
    assert_within(error, tolerances)


BALL = jc.Contact(0.02, 1e6)
DAMPED = jc.Damped(alpha=1.0)  # e = 0.6
WEIGHT = 0.02 * 9.81


def test_a_slow_bounce_settles():
    velocity = np.array([1e-6, 1e-5, 1e-4, 1e-3, 1.0])
    hit = impacts(DAMPED, BALL, velocity, external_force=WEIGHT)
    assert (hit.status == [1, 1, 1, 1, 0]).all()
    settled = hit.status == jc.Status.SETTLED
    assert np.isinf(hit.duration[settled]).all()
    assert (hit.restitution[settled] == 0).all() and (hit.rebound_velocity[settled] == 0).all()
    energy = 0.5 * 0.02 * velocity**2
    assert np.allclose(hit.energy_loss[settled], energy[settled], rtol=1e-14)
    assert np.isfinite(hit.max_indentation).all() and (hit.max_force > WEIGHT).all()
    # Fast impacts are hardly affected by the weight.
    free = jc.restitution(DAMPED)
    assert 0.97 * free < hit.restitution[-1] < free


def test_bad_forces_are_flagged():
    forces = np.array([WEIGHT, np.nan, np.inf, 0.0])
    pushed = impacts(DAMPED, BALL, external_force=forces)
    assert (pushed.status == [0, 3, 3, 0]).all()
    # A force that is an array is accepted with any value.
    free = impacts(DAMPED, BALL)
    assert free.method == "exact" and pushed.method == "event"
    assert np.isclose(pushed.duration[3], free.duration, rtol=PROMISE, atol=0)


def test_strong_damping_creeps_to_rest():
    hit = impacts(jc.Damped(1e4), BALL, np.array([1e-6, 1e-5]), external_force=WEIGHT)
    static = (WEIGHT / 1e6) ** (2 / 3)
    assert (hit.status == jc.Status.SETTLED).all() and np.isinf(hit.duration).all()
    assert np.allclose(hit.max_indentation, static, rtol=1e-12, atol=0)
    # The force at touch is damping; it falls to the weight.
    assert (hit.max_force >= WEIGHT).all()


def test_out_of_steps_before_the_turn_is_no_rest():
    """Little speed is left there, and the elastic energy must be counted."""
    forces, how = np.array([0.01, 0.1, 1.0]), jc.Event(max_steps=14)
    hit = impacts(jc.Hertz(), UNIT[1.5], external_force=forces, method=how)
    assert (hit.status == jc.Status.NOT_CONVERGED).all()
    for name in FIELDS:
        assert np.isnan(getattr(hit, "restitution" if name == "e" else name)).all(), name


@stored()
def let_go(n, zeta, push):
    """When the force of a clamped oscillator vanishes under a push, and the speed then."""
    c = 2 * zeta * np.sqrt((n + 1) / 2)

    def held(_, state):
        return max(state[0], 0) ** ((n + 1) / 2) + c * state[1]

    def motion(t, state):
        return state[1], push - max(state[0], 0) ** ((n - 1) / 2) * held(t, state)

    held.terminal, held.direction = True, -1
    path = solve_ivp(motion, (0, 10), (0, 1), "DOP853", events=held, rtol=3e-14, atol=1e-15)
    return path.t[-1], -path.y[1, -1]


def test_a_strong_pull_ends_a_contact_soon_after_its_turn():
    """Sooner than a first step: the event must not be missed where a way out starts with v = 0."""
    law, pulls = jc.AntypovElliott(e=0.3, tension=False), np.array([3.0, 30.0, 100.0])
    hit = impacts(law, UNIT[1.5], external_force=-pulls)
    zeta = float(law.damping_ratio(UNIT[1.5]))
    assert (hit.status == jc.Status.SEPARATED).all()
    found = np.stack([hit.duration, hit.restitution], 1)
    np.testing.assert_allclose(found, [let_go(1.5, zeta, -x) for x in pulls], rtol=BY_SCIPY)


@pytest.mark.slow(reason="both jacobians of an event solve with a push")
def test_derivatives_under_gravity():
    some = [c for c in grid("with_gravity", n=1.5) if not c.settled]

    def solve(p):
        alpha, gamma = p
        law, how = jc.Damped(alpha=alpha), jc.Event(rtol=1e-11)
        hit = jc.impact(law, UNIT[1.5], 1.0, external_force=gamma, method=how)
        return jnp.stack([hit.restitution, hit.duration, hit.max_indentation])

    p = jnp.stack([column(some, "alpha"), column(some, "gamma")], axis=1)
    _, *both = jax.vmap(lambda p: both_jacobians(solve, p))(p)
    names = ("e", "duration", "max_indentation")
    for slopes in both:
        for slope, by in zip(jnp.moveaxis(slopes, -1, 0), ("alpha", "gamma"), strict=True):
            want = np.array([[c.d[by][f] for f in names] for c in some], dtype=float)
            error = np.abs(slope - want) / np.maximum(np.abs(want), 1e-3)
            assert np.isfinite(slope).all()
            assert np.nanmax(error) <= SLOPE


def test_a_settled_neighbour_spoils_no_derivative():
    def total(mass):
        speeds = jnp.array([1e-5, 1.0])
        hit = jc.impact(DAMPED, jc.Contact(mass, 1e6), speeds, external_force=WEIGHT)
        return jnp.sum(hit.restitution) + hit.duration[1]

    assert np.isfinite(jax.jit(jax.grad(total))(0.02))


def test_another_solver_settles_too():
    # A method of order five takes many steps.
    how = jc.Event(solver=diffrax.Tsit5(), max_steps=2048)
    hit = impacts(DAMPED, BALL, np.array([1e-5, 1.0]), method=how, external_force=WEIGHT)
    np.testing.assert_array_equal(hit.status, [jc.Status.SETTLED, jc.Status.SEPARATED])


# α, the push, and the duration and e by the oracles here and of benchmarks/stability_map. Bodies
# that settle have no end, and NaN is not known.
EDGES = [
    # 1 + αv is rounding there, of either sign: taken for a pull it ended the contact at 3.9.
    (300.0, 1e-12, 44.37877139735737, 0.0033333333293278674),
    # The bodies are three thousand times as fast in between, and the slow end keeps its digits.
    (0.0, 1e4, 1.159456651217349, 1.0),
    # A weak pull ends a creeping contact where 1 + αv = 0: in v it has no digits.
    (300.0, -1e-12, 1.962981954914, 1 / 300),
    (1e4, -1e-12, 0.49105459638, 1e-4),
    (1e6, -1e4, 9.999939290341e-05, 1e-6),
    # A pull never settles. Where the contact ends at a creeping speed, rounding decided.
    (886909.0, -0.000227492, np.nan, np.nan),
    # Overdamped about their rest: what turned was rounding.
    (5.0, 1.0, np.inf, 0.0),
    (8.852, 0.629434, np.inf, 0.0),
]


def test_bodies_that_creep_and_strong_pushes():
    alpha, push, duration, e = np.transpose(EDGES)
    hit = impacts(jc.Damped(alpha=alpha), UNIT[1.5], external_force=push)
    settled, known = np.isinf(duration), ~np.isnan(duration)
    np.testing.assert_array_equal(hit.status, settled)
    np.testing.assert_allclose(hit.duration[known], duration[known], rtol=PROMISE)
    np.testing.assert_allclose(hit.restitution[known], e[known], rtol=PROMISE)
    assert np.isinf(hit.compression_time[settled]).all()


def test_what_creeps_to_rest_has_no_way_out():
    """Damped on approach only, and pushed: an elastic way out counted twice the force."""
    hit = impacts(given_ratio(np.array([300.0, 1e4]), "approach"), UNIT[1.5], external_force=1e4)
    assert (hit.status == jc.Status.SETTLED).all()
    # By the oracle of benchmarks/stability_map: the speed is largest before damping has grown.
    np.testing.assert_allclose(hit.max_force, [10734.70771105, 10788.53758967], rtol=PROMISE)


def test_an_end_where_the_force_hardly_falls():
    """A weak dashpot lets go of pushed bodies close to x = 0, where its force is flat.

    The search for that moment stood still beside it, and the duration was off by 1e-7.
    """
    zeta, push = 2.264928876230053e-06, 92.11293589467944
    law = given_ratio(np.array([zeta]), "clamped")
    hit = impacts(law, jc.Contact(1.0, 1.0, 3.0), external_force=push)
    assert hit.status == jc.Status.SEPARATED
    np.testing.assert_allclose(hit.duration, let_go(3.0, zeta, push)[0], rtol=FLAT)


def test_a_force_that_was_not_followed_to_its_largest_is_flagged():
    """A creep to rest was known from its speed, and the push returned for the largest force."""
    law, contact = given_ratio(np.array(500.0), "clamped"), jc.Contact(1.0, 1.0, 3.0)
    hit = impacts(law, contact, method=jc.Event(max_steps=40), external_force=1e4)
    assert hit.status == jc.Status.NOT_CONVERGED
    hit = impacts(law, contact, method="event", external_force=1e4)
    assert hit.status == jc.Status.SETTLED
    assert hit.max_force == pytest.approx(13994.75, rel=1e-5)


def test_a_conservative_law_returns_all_under_any_force():
    """The speeds are up to two thousand times that of the approach, and the energies 1e6 times."""
    forces = np.array([0.0, 1.0, 30.0, 1e3, 3e3, 1e4])
    hit = impacts(jc.Damped(alpha=0.0), UNIT[1.5], external_force=forces)
    assert (hit.status == jc.Status.SEPARATED).all()
    assert (hit.restitution == 1).all()
    # The elastic energy at the end, whose x is 0 up to rounding.
    assert (hit.energy_loss >= 0).all() and (hit.energy_loss < 1e-60).all()


@pytest.mark.parametrize("tension", [True, False])
def test_no_energy_is_gained(tension):
    """e² ≤ 1 + 2Γδ: a contact without tension ends at δ > 0, where the push has done work."""
    e, push = np.meshgrid([0.3, 0.9, 0.999, 1 - 1e-6, 1.0], [-100.0, -1.0, -1e-6, 1e-6, 1.0, 100.0])
    e, push = e.ravel(), push.ravel()
    hit = impacts(jc.AntypovElliott(e=e, tension=tension), UNIT[1.5], external_force=push)
    assert (hit.status <= jc.Status.SETTLED).all()
    gained = 2 * np.abs(push) * hit.max_indentation
    assert (np.square(hit.restitution) <= (1 if tension else 1 + gained) * (1 + 1e-12)).all()
    assert (hit.energy_loss >= 0).all()


@given(
    numbers=lanes(DAMPING), push=lanes(st.floats(-4, 4).map(lambda x: np.sign(x) * 10 ** abs(x)))
)
@settings(max_examples=25)
def test_a_push_gives_no_energy_to_a_contact_that_ends_where_it_began(numbers, push):
    hit = impacts(jc.Damped(alpha=numbers), UNIT[1.5], external_force=push)
    good = hit.status == jc.Status.SEPARATED
    e, lost = hit.restitution[good], hit.energy_loss[good]
    assert np.all((e >= 0) & (lost >= 0))
    # A pulled contact separates where its force vanishes, at δ > 0, before the pull has done its
    # work.
    assert np.all(e[push[good] > 0] <= 1)


@stored()
def taken(alpha, pull):
    """The energy loss where v² = 1 - 2Γx."""

    def depth(v):
        return (1 - v * v) / (2 * pull)

    with mp.workdps(oracle.DIGITS):
        by_damping = mp.quad(lambda v: alpha * v**2 * depth(v) ** 1.5 / pull, [-1 / mpf(alpha), 1])
        return float(by_damping + depth(1 / mpf(alpha)) ** 2.5 / 2.5)


def test_what_little_damping_takes_under_a_strong_pull():
    """The pull alone moves the bodies, v² = 1 - 2Γx, until the force vanishes at 1 + αv = 0."""
    alpha, pull = np.array([5.0, 300.0, 1e4]), 1e6
    hit = impacts(jc.Damped(alpha=alpha), UNIT[1.5], external_force=-pull)
    want = [taken(a, pull) for a in alpha.tolist()]
    assert np.allclose(hit.energy_loss, want, rtol=PROMISE, atol=0)


def test_a_solve_that_missed_something_is_flagged(monkeypatch):
    monkeypatch.setattr(errors, "_IMBALANCE", 1e-9)
    # No other test uses this tolerance, so the programs with the two limits stay distinct.
    law, how = jc.Damped(alpha=0.5), jc.Event(rtol=3e-9)
    hit = jc.impact(law, UNIT[1.5], 1.0, method=how, throw=False)
    path = jc.trajectory(law, UNIT[1.5], 1.0, samples=3, method=how)
    assert hit.status == jc.Status.NOT_CONVERGED and np.isnan(hit.restitution)
    assert path.status == jc.Status.NOT_CONVERGED
    assert np.isnan([path.time, path.velocity, path.force]).all()


# What is known of a contact: that it was followed to its end, turned inwards, creeps, has too
# little energy to part, and is not decided by rounding; "." is either.
VERDICTS = {
    "..1..": "settled",  # Creep is certain by itself.
    "..011": "settled",  # Bodies without the energy to part stay, however they move.
    "..010": "unknown",  # Rounding is as large as what they lack.
    "0.00.": "unknown",
    "1.000": "unknown",
    "11001": "settled",
    "10001": "separated",
}


def test_every_verdict_on_an_end():
    assert sum(2 ** row.count(".") for row in VERDICTS) == 2**5
    for row, want in VERDICTS.items():
        for flags in itertools.product(*("01" if x == "." else x for x in row)):
            arrived, settled, creeps, held, sharp = (x == "1" for x in flags)
            # What cannot hold in an impact is not computed.
            bare = Verdict(arrived, settled, creeps or None, held or None, None if sharp else False)
            for verdict in (Verdict(arrived, settled, creeps, held, sharp), bare):
                stays = "settled" if verdict.stays else "separated"
                assert (stays if verdict.known else "unknown") == want, flags

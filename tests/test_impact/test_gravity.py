"""A push or a pull during contact: separation later, earlier, or never."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxcontact as jc
from tests.test_impact.support import (
    UNIT,
    assert_within,
    both_jacobians,
    column,
    errors_of,
    given_ratio,
    grid,
)

# At the default rtol of 1e-9: measured 3.3e-9 (n = 3/2), 7.5e-9 (n = 1), twice that for the loss.
PROMISE, LOSS = 1e-8, 2e-8
# Measured 2e-9.
BY_SCIPY = 1e-8
# At rtol 1e-11, relative to the slope or 1e-3: measured 3.6e-7 where de/dΓ is small, else 1e-9.
SLOPE = 1e-6

# Of a duration: measured 7e-13.
FLAT = 1e-11


LANES = 12  # as many as the oracle has for one exponent


def pushed(law, number, contact, velocity, force):
    """The impacts of `law(number)` under forces, in as many lanes as others have.

    Other numbers of lanes would be other programs, and it takes seconds to compile one.
    """
    lanes = np.broadcast_shapes(*(np.shape(x) for x in (number, velocity, force)))[0]
    assert lanes <= LANES
    number, velocity, force = (
        jnp.resize(jnp.broadcast_to(jnp.asarray(x, float), (lanes,)), LANES)
        for x in (number, velocity, force)
    )
    hit = jc.impact(law(number), contact, velocity, external_force=force)
    return jax.tree.map(lambda x: x[:lanes], hit)


def damped(alpha):
    return jc.Damped(alpha=alpha)


def hu_guo(e):
    return jc.HuGuo(e=e)


@pytest.mark.parametrize("n", [1.5, 1.0])
def test_against_the_oracle(n):
    some = grid("with_gravity", n=n)
    hit = pushed(damped, column(some, "alpha"), UNIT[n], 1.0, column(some, "gamma"))
    settled = np.array([c.settled for c in some])
    assert settled.sum() == 1
    assert (hit.status == jnp.where(settled, jc.Status.SETTLED, jc.Status.SEPARATED)).all()
    assert hit.method == "event"
    error = errors_of(hit, some)
    # For a contact that settles the oracle's duration is the time of its second turn.
    assert np.isinf(hit.duration[settled]).all()
    error["duration"] = np.where(settled, 0, error["duration"])
    tolerances = dict.fromkeys(error, PROMISE) | {"energy_loss": LOSS}
    assert_within(error, tolerances)


BALL = jc.Contact(0.02, 1e6)
WEIGHT = 0.02 * 9.81


def test_a_slow_bounce_settles():
    velocity = jnp.array([1e-6, 1e-5, 1e-4, 1e-3, 1.0])
    hit = pushed(hu_guo, 0.6, BALL, velocity, WEIGHT)
    assert (hit.status == jnp.array([1, 1, 1, 1, 0])).all()
    settled = hit.status == jc.Status.SETTLED
    assert np.isinf(hit.duration[settled]).all()
    assert (hit.restitution[settled] == 0).all() and (hit.rebound_velocity[settled] == 0).all()
    energy = 0.5 * 0.02 * np.asarray(velocity) ** 2
    assert np.allclose(hit.energy_loss[settled], energy[settled], rtol=1e-14)
    assert np.isfinite(hit.max_indentation).all() and (hit.max_force > WEIGHT).all()
    # Fast impacts are hardly affected by the weight.
    free = jc.impact(jc.HuGuo(e=0.6), BALL, 1.0)
    assert 0.97 * free.restitution < hit.restitution[-1] < free.restitution


def test_strong_damping_creeps_to_rest():
    contact = jc.Contact(jnp.array(0.02), jnp.array(1e6))
    velocity = jnp.array([1e-6, 1e-5])
    hit = pushed(damped, 1e4, contact, velocity, WEIGHT)
    static = (WEIGHT / 1e6) ** (2 / 3)
    assert (hit.status == jc.Status.SETTLED).all() and np.isinf(hit.duration).all()
    assert np.allclose(hit.max_indentation, static, rtol=1e-12, atol=0)
    # The force at touch is damping; it falls to the weight.
    assert (hit.max_force >= WEIGHT).all()


def test_out_of_steps_before_the_turn_is_no_rest():
    """Little speed is left there, and the elastic energy must be counted."""
    contact, forces = jc.Contact(1.0, 1.0), jnp.array([0.01, 0.1, 1.0])
    hit = jc.impact(jc.Hertz(), contact, 1.0, external_force=forces, method=jc.Event(max_steps=14))
    assert (hit.status == jc.Status.NOT_CONVERGED).all() and np.isnan(hit.max_indentation).all()


def test_a_push_delays_and_a_pull_hastens():
    forces = jnp.array([-4.0, -1.0, 0.0, 1.0, 4.0])
    hit = pushed(hu_guo, 0.6, jc.Contact(0.7, 3e5), 0.3, forces)
    assert (hit.status == jc.Status.SEPARATED).all()
    assert (jnp.diff(hit.duration) > 0).all() and (jnp.diff(hit.max_indentation) > 0).all()
    # At x = 0 the constant force has done no work, so e is 1 without damping.
    elastic = pushed(damped, 0.0, jc.Contact(0.7, 3e5), 0.3, forces)
    assert np.allclose(elastic.restitution, 1, rtol=PROMISE)
    assert np.abs(elastic.energy_loss).max() <= LOSS * 0.5 * 0.7 * 0.3**2


def test_a_pull_that_the_contact_may_not_follow():
    # For 1 + α v/v0 < 0 the force is zero, unless the law may pull; then the contact lasts longer.
    pulled = {
        tension: pushed(
            lambda alpha, tension=tension: jc.Damped(alpha=alpha, tension=tension),
            *(jnp.array([2.0]), UNIT[1.5], 1.0, -0.5),
        )
        for tension in (False, True)
    }
    assert all(hit.status == jc.Status.SEPARATED for hit in pulled.values())
    assert pulled[True].duration >= pulled[False].duration * (1 - PROMISE)


@pytest.mark.parametrize("pull", [3.0, 30.0, 100.0])
def test_a_strong_pull_ends_a_contact_soon_after_its_turn(pull):
    """Sooner than a first step: the event must not be missed where a way out starts with v = 0."""
    law = jc.AntypovElliott(e=0.3, tension=False)
    hit = jc.impact(law, UNIT[1.5], 1.0, external_force=-pull)
    zeta = float(law.damping_ratio(UNIT[1.5]))

    def force(x, v):
        x = max(x, 0.0)
        return x**1.5 + 2 * zeta * np.sqrt(1.25) * x**0.25 * v

    def vanishes(t, y):
        return force(*y) if y[1] < 0 else 1.0

    vanishes.terminal = True
    by_scipy = solve_ivp(
        lambda t, y: [y[1], -pull - force(*y)],
        *((0, 10), [0.0, 1.0], "DOP853"),
        **{"events": vanishes, "rtol": 1e-12, "atol": 1e-15, "max_step": 1e-2 / pull},
    )
    assert hit.status == jc.Status.SEPARATED
    assert np.isclose(hit.duration, by_scipy.t[-1], rtol=BY_SCIPY, atol=0)
    assert np.isclose(hit.restitution, -by_scipy.y[1, -1], rtol=BY_SCIPY, atol=0)


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
        hit = jc.impact(
            jc.HuGuo(e=0.6), jc.Contact(mass, 1e6), jnp.array([1e-5, 1.0]), external_force=WEIGHT
        )
        return jnp.sum(hit.restitution) + hit.duration[1]

    assert jnp.isfinite(jax.grad(total)(0.02))


@pytest.mark.slow(reason="2048 steps of another solver")
def test_another_solver_settles_too():
    hit = jc.impact(
        jc.HuGuo(e=0.6),
        BALL,
        jnp.array([1e-5, 1.0]),
        # A method of order five takes many steps.
        method=jc.Event(solver=diffrax.Tsit5(), max_steps=2048),
        external_force=WEIGHT,
    )
    assert (hit.status == jnp.array([jc.Status.SETTLED, jc.Status.SEPARATED])).all()


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
    hit = pushed(damped, alpha, UNIT[1.5], 1.0, push)
    settled, known = np.isinf(duration), ~np.isnan(duration)
    np.testing.assert_array_equal(hit.status, settled)
    np.testing.assert_allclose(hit.duration[known], duration[known], rtol=PROMISE)
    np.testing.assert_allclose(hit.restitution[known], e[known], rtol=PROMISE)
    assert np.isinf(hit.compression_time[settled]).all()


def test_what_creeps_to_rest_has_no_way_out():
    """Damped on approach only, and pushed: an elastic way out counted twice the force."""
    law = given_ratio(jnp.array([300.0, 1e4]), "approach")
    hit = jc.impact(law, UNIT[1.5], 1.0, external_force=1e4)
    assert (hit.status == jc.Status.SETTLED).all()
    # By the oracle of benchmarks/stability_map: the speed is largest before damping has grown.
    np.testing.assert_allclose(hit.max_force, [10734.70771105, 10788.53758967], rtol=PROMISE)


def test_an_end_where_the_force_hardly_falls():
    """A weak dashpot lets go of pushed bodies close to x = 0, where the force x³ + c x v is flat.

    The search for that moment stood still beside it, and the duration was off by 1e-7.
    """
    zeta, push = 2.264928876230053e-06, 92.11293589467944
    c = zeta * np.sqrt(8)

    def rate(_, state):
        x, v = state
        return v, push - x**3 - c * x * v

    def held(_, state):
        return state[0] ** 2 + c * state[1]

    held.terminal, held.direction = True, -1
    # Past touch, where the force is zero as well.
    start = (1e-6, np.sqrt(1 + 2 * push * 1e-6))
    path = solve_ivp(rate, (0, 2), start, "DOP853", events=held, rtol=3e-14, atol=1e-15)
    before = 1e-6 * 2 / (1 + start[1])
    hit = pushed(
        lambda z: given_ratio(z, "clamped"), np.array([zeta]), jc.Contact(1.0, 1.0, 3.0), 1.0, push
    )
    assert (hit.status == jc.Status.SEPARATED).all()
    np.testing.assert_allclose(hit.duration, path.t_events[0] + before, rtol=FLAT)

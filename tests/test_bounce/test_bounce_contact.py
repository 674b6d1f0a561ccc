"""A ball with its weight acting in contact, down to rest, against Newton's equation by SciPy."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._laws import AbstractHuntCrossley, AbstractOscillator, constant_laws
from tests.oracle import bouncing_ball
from tests.oracle.bouncing_ball import Touch

SAME = 1e-8
"""Of the speeds and times of a run, in units of the first touch: measured 6e-11 for Thornton's law,
8e-12 for Hu and Guo's.
"""

ROUNDING = 1e-12  # of the indentation at rest, which is a formula

GRAVITY, MASS = 9.81, 1.0
BALLS = {"light": (1e6, 0.4), "between": (3e4, 0.1), "heavy": (2e3, 0.05)}
"""Stiffness and drop height of balls that sink in by 1e-3 to a fifth of the way at rest."""


def hunt_crossley(law, n):
    """F = K δⁿ (1 + α(v0) δ'/v0)."""
    alpha = jax.jit(lambda v, K: law.damping_factor(jc.Contact(MASS, K, n), v))

    @functools.cache
    def at(v0, K):
        return float(alpha(v0, K))

    def force(K, depth, rate, v0):
        return K * depth**n * (1 + at(v0, K) * rate / v0)

    return force


def oscillator(law, n):
    """F = K δⁿ + 2ζ √((n+1)/2) √(Km) δ^((n-1)/2) δ', of approach alone for Jankowski's law."""
    zeta = float(law.damping_ratio(jc.Contact(MASS, 1.0, n)))

    def force(K, depth, rate, v0):
        rate = max(rate, 0.0) if isinstance(law, jc.Jankowski) else rate
        damping = 2 * zeta * np.sqrt((n + 1) / 2 * K * MASS) * depth ** ((n - 1) / 2)
        return K * depth**n + damping * rate

    return force


def viscoelastic(law, n):
    """F = K (δⁿ + n A δ^(n-1) δ')."""
    A = float(law.A)
    return lambda K, depth, rate, v0: K * (depth**n + n * A * depth ** (n - 1) * rate)


def assert_same(law, n, make, balls=BALLS, v0="peak"):
    """Every touch of every ball, its rest, and what is derived from them."""
    K, height = np.array(list(balls.values())).T
    # Laws as lanes share their program with others.
    laws = jax.tree.map(lambda number: jnp.asarray(np.full(len(K), number)), law)
    run = jc.bounce(laws, jc.Contact(MASS, K, n), height, gravity_in_contact=True, v0=v0)
    run, force, longest = jax.tree.map(np.asarray, run), make(law, n), 0
    for lane, (stiffness, drop) in enumerate(balls.values()):
        speed = np.sqrt(2 * GRAVITY * drop)
        unit = 3 * (MASS / stiffness) ** (1 / (n + 1)) * speed ** ((1 - n) / (n + 1))
        rows, rest = bouncing_ball.touches(
            functools.partial(force, stiffness),
            mass=MASS,
            gravity=GRAVITY,
            height=drop,
            unit=unit,
            tension=law.tension,
            peak=v0 == "peak",
            # A constant c damps less at lower speeds: its light ball bounces 262 times.
            most=300,
        )
        count = len(rows)
        longest = max(longest, count + 1)
        assert rest is not None and bool(run.at_rest[lane])
        left = run.status[lane] == jc.Status.SEPARATED
        assert left.sum() == count and left[:count].all()
        scales = Touch(rest, unit, unit, speed, 1, drop)
        for name, scale in scales._asdict().items():
            ours = getattr(run, name)[lane, :count]
            theirs = np.array([getattr(row, name) for row in rows])
            assert np.all(np.abs(ours - theirs) <= SAME * scale), (name, lane, ours - theirs)
        assert abs(run.rest_time[lane] - rest) <= SAME * rest
        assert np.all(run.time[lane, count:] == run.rest_time[lane])
        assert run.impact_velocity[lane, count] > 0
        assert np.all(run.impact_velocity[lane, count + 1 :] == 0)
        static = (MASS * GRAVITY / stiffness) ** (1 / n)
        np.testing.assert_allclose(run.rest_indentation[lane], static, rtol=ROUNDING)
    # No longer than the last ball requires.
    assert run.time.shape == (len(balls), longest)


def test_damping_refers_to_the_largest_closing_speed():
    assert_same(jc.HuGuo(e=0.7), 1.5, hunt_crossley)


def every_law():
    """Every registered law that comes to rest, with and without tension where that matters."""
    for name in constant_laws():
        law = jc.get_law(name, e=0.5)
        if isinstance(law, AbstractOscillator):
            n = law.exponents[0] if law.exponents else 1.5
            for tension in (False, True):
                yield jc.get_law(name, e=0.5, tension=tension), n, oscillator
        elif isinstance(law, AbstractHuntCrossley):
            yield law, 1.5, hunt_crossley
    yield jc.EnergyLoss(e=0.5, beta=1.3), 1.5, hunt_crossley
    yield jc.ConstantDamping(c=4e4), 1.5, hunt_crossley
    yield jc.MarhefkaOrin(a=0.2), 1.5, hunt_crossley
    yield jc.PowerDamping(c=2e4, power=-0.4, reference=1.0), 1.5, hunt_crossley
    yield jc.PowerRestitution(loss=0.4, power=0.1, reference=1.0), 1.5, hunt_crossley
    for tension, n in ((False, 1.5), (False, 2.0), (True, 2.0)):
        yield jc.KuwabaraKono(A=4e-3, tension=tension), n, viscoelastic


def words(case):
    law, n, _ = case
    return f"{type(law).__name__}-{n:g}-{'pulls' if law.tension else 'pushes'}"


CASES = {words(case): case for case in every_law()}
# One of each equation, in which other cases have other factors. HuGuo and Damped have their tests.
QUICK = set(
    "KelvinVoigt-1-pulls Jankowski-1.5-pushes Thornton-1.5-pushes KuwabaraKono-1.5-pushes".split()
)


@pytest.mark.slow(*(CASES.keys() - QUICK), reason="another factor in an equation of other cases")
@pytest.mark.parametrize("name", CASES)
def test_every_law(name):
    law, n, make = CASES[name]
    # With damping that falls with the speed a heavy ball creeps, too slowly for the oracle. A light
    # one bounces 319 times with a power of the speed.
    balls = dict(BALLS)
    if isinstance(law, jc.PowerDamping):
        del balls["light"]
    if isinstance(law, jc.PowerDamping | jc.ConstantDamping):
        del balls["heavy"]
    assert_same(law, n, make, balls)


def test_damping_that_refers_to_the_touch():
    assert_same(jc.Damped(alpha=0.8, tension=True), 2.2, hunt_crossley, v0="touch")


def test_lanes_that_do_not_come_to_rest():
    law = jc.HuGuo(e=np.array([0.8, 1.5, 1.0]))
    contact, height = jc.Contact(MASS, np.full(3, 1.4e8)), np.full(3, 0.9)
    run = jax.tree.map(np.asarray, jc.bounce(law, contact, height, gravity_in_contact=True))
    assert np.isnan(run.time[1]).all() and (run.status[1] == jc.Status.INVALID_INPUT).all()
    assert np.isnan(run.rest_time[2]) and (run.status[2] == jc.Status.SEPARATED).all()
    assert run.remaining_flight is None
    # The weight reduces every rebound, and slower ones more.
    e = run.restitution[0, run.status[0] == jc.Status.SEPARATED]
    assert 15 < len(e) < 25
    assert e[0] < float(jc.restitution(jc.HuGuo(e=0.8))) and np.all(np.diff(e) < 0)

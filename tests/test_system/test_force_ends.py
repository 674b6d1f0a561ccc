"""Forces that jump at a touch, and those that end before the gap opens: values and derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

import jaxcontact as jc

BESIDE = 2e-8
"""Of e and duration beside `impact`, relative. Measured at most 3e-11 at rtol 1e-9, and 2e-9 for
the strong dashpot."""

SLOPES = 3e-7
"""Of their slopes by speed, relative. Measured at most 7e-8 at rtol 1e-9."""

PEAK = 1e-6
PEAK_SLOPE = 2e-5
"""Of the largest force, which is read between steps, and its slope. Measured 7e-8 and 7e-6."""


def one(t, q, args):
    return jnp.eye(1)


def pushed(t, q, v, args):
    return -args * jnp.ones(1)


def height(t, q, args):
    return q


def columns(contacts):
    return jnp.stack([contacts.restitution[0], contacts.duration[0], contacts.max_force[0]])


def solved(law_of, stiffness, exponent, duration, several):
    """Return a program for the columns of a touch at t = 0 and of `impact`, both with slopes by
    speed, at some pushes, for laws of some numbers.
    """

    def mechanism(v, push, number):
        system = jc.System(
            one, pushed, height, law=law_of(number), stiffness=stiffness, exponent=exponent
        )
        start = {"position": [0.0], "velocity": -v[None], "args": push}
        return columns(jc.simulate(system, duration, **start, max_impacts=4).contacts)

    def alone(v, push, number):
        contact = jc.Contact(1.0, stiffness, exponent)
        pushed = {"external_force": push, "method": jc.Event(rtol=1e-11)} if several else {}
        hit = jc.impact(law_of(number), contact, v, **pushed)
        return jnp.stack([hit.restitution, hit.duration, hit.max_force])

    def both(push, number):
        at, along = (1.0, push, number), (1.0, 0.0, jnp.zeros_like(number))
        return [jax.jvp(f, at, along) for f in (mechanism, alone)]

    return jax.jit(jax.vmap(both))


PUSHES = [0.0, -20.0, 20.0, 0.0]


def plastic(c):
    """For c = 0 it is Thornton's."""
    return jc.Viscoplastic(yield_speed=0.1, c=c)


@pytest.mark.parametrize(
    ("law_of", "stiffness", "exponent", "duration", "numbers", "known"),
    [
        (plastic, 1e7, 1.5, 0.05, [0.0, 0.0, 0.0, 2e6], {0: 0.005673875463, 3: 0.005661013458}),
        (lambda ratio: jc.WaltonBraun(ratio=ratio, slope=0.0), 1e4, 1.0, 0.07, [3.0] * 3, {}),
        (jc.HuGuo, 1e7, 1.5, 0.1, [0.03], {0: 0.02405775735715}),
        (lambda c: jc.LinearDashpot(c=c), 1e6, 1.0, 0.01, [300.0] * 3 + [3000.0], {}),
    ],
    ids=["plastic", "walton braun", "hu guo", "dashpot"],
)
def test_table_and_impact_end_together(law_of, stiffness, exponent, duration, numbers, known):
    both = solved(law_of, stiffness, exponent, duration, len(numbers) > 1)
    pushes = PUSHES[: len(numbers)]
    (value, slope), (expected, rate) = both(jnp.array(pushes), jnp.array(numbers))
    np.testing.assert_allclose(value[:, :2], expected[:, :2], rtol=BESIDE)
    np.testing.assert_allclose(slope[:, :2], rate[:, :2], rtol=SLOPES, atol=2e-7)
    np.testing.assert_allclose(value[:, 2], expected[:, 2], rtol=PEAK)
    np.testing.assert_allclose(slope[:, 2], rate[:, 2], rtol=PEAK_SLOPE)
    for lane, expected in known.items():
        assert abs(value[lane, 1] / expected - 1) < BESIDE
    if numbers[0] == 3:
        # The force of two springs is zero at the same speed, whatever pushes.
        np.testing.assert_allclose(value[:, 0], 3**-0.5, rtol=BESIDE)
    if numbers[-1] == 3000:
        # It jumps to c v0 and falls from there.
        assert abs(value[-1, 2] / 3000 - 1) < 1e-12


MASS, WALL, STIFFNESS, DASHPOT, END, SPEED = 0.01, 0.05, 1e4, 2.0, 0.03, 1e-3

EXACT = [
    (2.8, -1.64434366882867, 1.05489342444656),
    (3.0, -1.42773884104707, 1.11019439359009),
    (3.2, -1.20061915482328, 1.16018980595758),
]
"""Forces, with the speed at END and its slope, in 30 digits: flight, a damped oscillation until
k δ + c δ' = 0, and flight again."""

SLOPE = 3e-7
"""Of the slopes below, relative; measured at most 2e-7 at rtol 1e-9, and 3e-2 with accelerations
from before the touch."""


@pytest.mark.parametrize("compiled", [True, False])
def test_slopes_behind_a_dashpot_are_exact(compiled):
    law = jc.LinearDashpot(c=DASHPOT)

    def mass(t, q, args):
        return MASS * jnp.eye(1)

    def drives(t, q, v, args):
        return args[None]

    def to_wall(t, q, args):
        return WALL - q

    system = jc.System(mass, drives, to_wall, law=law, stiffness=STIFFNESS, exponent=1.0)

    def end(force):
        start = {"position": [0.0], "velocity": [SPEED], "args": force}
        return jc.simulate(system, END, **start, max_impacts=8).velocity[-1, 0]

    def both(force):
        return jax.jvp(end, (force,), (jnp.ones_like(force),))

    forces, speeds, rates = map(jnp.array, zip(*EXACT, strict=True))
    if compiled:
        values, slopes = jax.jit(jax.vmap(both))(forces)
    else:
        values, slopes = map(np.array, zip(*map(both, forces), strict=True))
    np.testing.assert_allclose(values, speeds, rtol=1e-9)
    np.testing.assert_allclose(slopes, rates, rtol=SLOPE)


def test_largest_force_of_a_contact_that_the_run_ends_in():
    """It is the force at the end, whose slopes the states have, too."""
    weight = jnp.array(9.81)
    system = jc.System(one, pushed, height, law=jc.HuGuo(e=0.7), stiffness=1e6)

    def forces(h, duration):
        start = {"position": h[None], "velocity": [0.0], "args": weight}
        run = jc.simulate(system, duration, **start, rtol=1e-11, max_impacts=4)
        return jnp.stack([run.contacts.max_force[0], run.states.force[-1, 0]])

    slopes = jax.jit(jax.jacfwd(forces, (0, 1)))(jnp.array(0.01), jnp.array(0.0455))
    by_height, by_duration = map(np.array, slopes)
    np.testing.assert_allclose(by_height, -30603.6255, rtol=1e-7)
    np.testing.assert_allclose(by_duration, 13660.1401, rtol=1e-7)


def test_slopes_of_touch_times_do_not_lose_digits():
    """A ball falls on a table a sin ωt: dt = -∂gap/(∂gap/∂t), and so the closing speed."""
    system = jc.System(
        one,
        lambda t, q, v, args: -9.81 * jnp.ones(1),
        lambda t, q, args: q - args[0] * jnp.sin(args[1] * t),
        law=jc.HuGuo(e=0.6),
        stiffness=1e6,
    )
    g, h, a, w = 9.81, 0.12, 0.004, 30.0

    def table(x, rtol):
        start = {"position": x[:1], "velocity": [-0.3], "args": x[1:]}
        run = jc.simulate(system, 0.2, **start, rtol=rtol, max_impacts=4)
        return jnp.stack([run.contacts.time[0], run.contacts.closing_speed[0]])

    def gap(t):
        return h - 0.3 * t - g * t**2 / 2 - a * np.sin(w * t)

    t = scipy.optimize.brentq(gap, 1e-3, 0.3, xtol=1e-16)
    closing = 0.3 + g * t + a * w * np.cos(w * t)
    pace = g - a * w**2 * np.sin(w * t)
    times = np.array([1, -np.sin(w * t), -a * t * np.cos(w * t)]) / closing
    aside = np.array([0, w * np.cos(w * t), a * np.cos(w * t) - a * w * t * np.sin(w * t)])
    speeds = pace * times + aside
    # Measured 1.1e-12 and 5e-16; 1e-8 at the tighter one if roots are cut off.
    for rtol, limit in ((1e-9, 1e-11), (1e-12, 1e-13)):
        found = np.array(jax.jacfwd(lambda x: table(x, rtol))(jnp.array([h, a, w])))  # noqa: B023
        assert np.abs(found[0] - times).max() < limit
        assert np.abs(found[1] - speeds).max() < 20 * limit

"""Forces that jump at a touch, and those that end before the gap opens: values and derivatives."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

import jaxcontact as jc
from tests.oracle.stored import stored

BESIDE = 2e-8
"""Of e and duration beside `impact`, relative. Measured at most 3e-11 at rtol 1e-9, and 2e-9 for
the strong dashpot."""

SLOPES = 3e-7
"""Of slopes, relative. Measured at most 7e-8 for those of e and duration by speed at rtol 1e-9, and
2e-7 for the speed behind a dashpot, which was 3e-2 with accelerations from before the touch."""

PEAK = 1e-6
PEAK_SLOPE = 2e-5
"""Of the largest force, which is read between steps, and its slope. Measured 7e-8 and 7e-6."""


BOOKS = 1e-9  # of energies of some 1 J at rtol 1e-9, in J


class Body(NamedTuple):
    """A body above a table that moves by a sin ωt, with a number of its law."""

    number: float
    duration: float
    stiffness: float
    speed: float = 1.0
    push: float = 0.0
    mass: float = 1.0
    position: float = 0.0
    table: float = 0.0
    a: float = 0.0
    rate: float = 0.0


def mass(t, q, x):
    return x.mass * jnp.eye(1)


def pushed(t, q, v, x):
    return -x.push * jnp.ones(1)


def height(t, q, x):
    return q + x.table - x.a * jnp.sin(x.rate * t)


def run_of(law_of, exponent, rtol, x):
    """Return e, duration, largest force, time and speed of the first touch; force and speed at the
    end; and the energy that is missing there.
    """
    how = {"law": law_of(x.number), "stiffness": x.stiffness, "exponent": exponent}
    # A derivative takes time by the count of numbers that vary.
    args = x._replace(number=None, duration=None, stiffness=None, speed=None, position=None)
    start = {"position": x.position[None], "velocity": -x.speed[None], "args": args}
    system = jc.System(mass, pushed, height, **how)
    run = jc.simulate(system, x.duration, **start, rtol=rtol, max_impacts=8)
    names = "restitution", "duration", "max_force", "time", "closing_speed"
    columns = [getattr(run.contacts, name)[0] for name in names]
    lost = jnp.sum(jnp.where(run.contacts.valid, run.contacts.energy_loss, 0))
    gained = run.energy[-1] - run.energy[0] + lost
    ends = run.states.force[-1, 0], -run.velocity[-1, 0], gained - run.states.work[-1]
    return jnp.stack([*columns, *ends])


@functools.partial(jax.jit, static_argnums=(0, 1, 2))
def impact_of(law_of, exponent, several, x):
    contact = jc.Contact(x.mass, x.stiffness, exponent)
    how = {"external_force": x.push, "method": jc.Event(rtol=1e-11)} if several else {}
    hit = jc.impact(law_of(x.number), contact, x.speed, **how)
    return jnp.stack([hit.restitution, hit.duration, hit.max_force])


def values_and_slopes(function, lanes):
    """Return values and slopes of pairs of a body and the name of one of its numbers."""
    bodies = Body(*(jnp.array(x, float) for x in zip(*(body for body, _ in lanes), strict=True)))
    along = Body(*(jnp.array([float(name == f) for _, name in lanes]) for f in Body._fields))
    both = jax.vmap(lambda x, dx: jax.jvp(function, (x,), (dx,)))(bodies, along)
    return map(np.asarray, both)


def plastic(c):
    """For c = 0 it is Thornton's."""
    return jc.Viscoplastic(yield_speed=0.1, c=c)


def walton_braun(ratio):
    return jc.WaltonBraun(ratio=ratio, slope=0.0)


def dashpot(c):
    return jc.LinearDashpot(c=c)


EXACT = {
    2.8: (-1.64434366882867, 1.05489342444656),
    3.0: (-1.42773884104707, 1.11019439359009),
    3.2: (-1.20061915482328, 1.16018980595758),
}
"""By the push, the speed at the end and its slope, in 30 digits: flight, a damped oscillation until
k δ + c δ' = 0, and flight again."""

BEHIND = [
    (Body(2.0, 0.03, 1e4, speed=1e-3, push=push, mass=0.01, table=0.05), "push") for push in EXACT
]
ZETAS = np.random.default_rng(0).uniform(0.05, 0.95, 40)
FREE = [(Body(2e3 * zeta, 0.01, 1e6, speed=3.0), "number") for zeta in ZETAS]
ENDS = Body(0.7, 0.0455, 1e6, speed=0.0, push=9.81, position=0.01)
FALLS = Body(0.6, 0.2, 1e6, speed=0.3, push=9.81, position=0.12, a=0.004, rate=30.0)
OTHERS = {
    dashpot: FREE + BEHIND,
    jc.HuGuo: [(ENDS, "position"), (ENDS, "duration")]
    + [(FALLS, name) for name in ("position", "a", "rate")],
}
"""Lanes of other tests, in the programs of the table."""

TABLE = {
    jc.HuGuo: [Body(0.03, 0.1, 1e7)],
    plastic: [Body(c, 0.05, 1e7, push=p) for c, p in ((0, 0), (0, -20), (0, 20), (2e6, 0))],
    walton_braun: [Body(3.0, 0.07, 1e4, push=push) for push in (0.0, -20.0, 20.0)],
    dashpot: [Body(c, 0.01, 1e6, push=p) for c, p in ((300, 0), (300, -20), (300, 20), (3000, 0))],
}
EXPONENTS = {plastic: 1.5, walton_braun: 1.0, jc.HuGuo: 1.5, dashpot: 1.0}
KNOWN = {plastic: {0: 0.005673875463, 3: 0.005661013458}, jc.HuGuo: {0: 0.02405775735715}}
"""Durations by lane."""


@functools.cache
def solved(law_of, rtol=1e-9):
    """Return values and slopes of all lanes of a law, each (lanes, columns)."""
    lanes = [(body, "speed") for body in TABLE[law_of]] + OTHERS.get(law_of, [])
    return tuple(
        values_and_slopes(functools.partial(run_of, law_of, EXPONENTS[law_of], rtol), lanes)
    )


@stored()
def of_impacts(name, bodies):
    """Return values and slopes by the speed of isolated impacts."""
    (law_of,) = (one for one in TABLE if one.__name__ == name)
    function = functools.partial(impact_of, law_of, EXPONENTS[law_of], len(bodies) > 1)
    return list(values_and_slopes(function, [(Body(*body), "speed") for body in bodies]))


@pytest.mark.parametrize("law_of", TABLE, ids=lambda f: f.__name__)
def test_table_and_impact_end_together(law_of):
    bodies = TABLE[law_of]
    expected, rate = of_impacts(law_of.__name__, bodies)
    value, slope = (x[: len(bodies)] for x in solved(law_of))
    np.testing.assert_allclose(value[:, :2], expected[:, :2], rtol=BESIDE)
    np.testing.assert_allclose(slope[:, :2], rate[:, :2], rtol=SLOPES, atol=2e-7)
    np.testing.assert_allclose(value[:, 2], expected[:, 2], rtol=PEAK)
    np.testing.assert_allclose(slope[:, 2], rate[:, 2], rtol=PEAK_SLOPE)
    assert np.max(np.abs(value[:, 7])) < BOOKS
    for lane, duration in KNOWN.get(law_of, {}).items():
        assert abs(value[lane, 1] / duration - 1) < BESIDE
    if law_of is walton_braun:
        # The force of two springs is zero at the same speed, whatever pushes.
        np.testing.assert_allclose(value[:, 0], 3**-0.5, rtol=BESIDE)
    if law_of is dashpot:
        # It jumps to c v0 and falls from there.
        assert abs(value[-1, 2] / 3000 - 1) < 1e-12


def test_slopes_behind_a_dashpot_are_exact():
    values, slopes = (x[-len(EXACT) :, 6] for x in solved(dashpot))
    speeds, rates = np.transpose(list(EXACT.values()))
    np.testing.assert_allclose(values, speeds, rtol=1e-9)
    np.testing.assert_allclose(slopes, rates, rtol=SLOPES)


def test_slopes_where_a_force_ends_are_exact():
    """ln e = -ζ T and T = 2 arccos ζ/√(1 - ζ²) in units of √(m/k), up to the end of the force."""
    values, slopes = (x[4 : 4 + len(FREE), :2] for x in solved(dashpot))
    square = 1 - ZETAS**2
    lasts = 2 * np.arccos(ZETAS) / np.sqrt(square)
    e, longer = np.exp(-ZETAS * lasts), (ZETAS * lasts - 2) / square
    rates = np.transpose([-e * (lasts + ZETAS * longer), 1e-3 * longer]) / 2e3
    # Measured 5e-12 and 2e-10. Slopes were off by up to 5e-6 if a step ended at the kink.
    np.testing.assert_allclose(values, np.transpose([e, 1e-3 * lasts]), rtol=1e-10)
    np.testing.assert_allclose(slopes, rates, rtol=2e-9)


def test_largest_force_of_a_contact_that_the_run_ends_in():
    """It is the force at the end, whose slopes the states have, too."""
    by_height, by_duration = solved(jc.HuGuo, 1e-12)[1][1:3, [2, 5]]
    np.testing.assert_allclose(by_height, -30603.6255, rtol=1e-7)
    np.testing.assert_allclose(by_duration, 13660.1401, rtol=1e-7)


def test_slopes_of_touch_times_do_not_lose_digits():
    """A ball falls on a table a sin ωt: dt = -∂gap/(∂gap/∂t), and so the closing speed."""
    g, h, speed, a, w = FALLS.push, FALLS.position, FALLS.speed, FALLS.a, FALLS.rate

    def gap(t):
        return h - speed * t - g * t**2 / 2 - a * np.sin(w * t)

    t = scipy.optimize.brentq(gap, 1e-3, 0.3, xtol=1e-16)
    closing = speed + g * t + a * w * np.cos(w * t)
    pace = g - a * w**2 * np.sin(w * t)
    times = np.array([1, -np.sin(w * t), -a * t * np.cos(w * t)]) / closing
    aside = np.array([0, w * np.cos(w * t), a * np.cos(w * t) - a * w * t * np.sin(w * t)])
    speeds = pace * times + aside
    # Measured 1.1e-12 and 5e-16; 1e-8 at the tighter one if roots are cut off.
    for rtol, limit in ((1e-9, 1e-11), (1e-12, 1e-13)):
        of_time, of_speed = solved(jc.HuGuo, rtol)[1][3:, 3:5].T
        assert np.abs(of_time - times).max() < limit
        assert np.abs(of_speed - speeds).max() < 20 * limit

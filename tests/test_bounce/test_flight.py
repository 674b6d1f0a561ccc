"""Motion under gravity and quadratic drag, against integration of v' = -g (1 + b v |v|)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxcontact._flight import Drag, Flight

G = 9.81
TABLE_TENNIS = Drag(mass=0.0027, radius=0.02, coefficient=0.5)
LAUNCHES = np.array([0.05, 0.7, 3.0, 9.0])
RATES = [0.0, 1e-4, 0.0143, 0.3]

INTEGRATION = 1e-9  # DOP853 at rtol 1e-12 against the closed forms, relative: 5e-10 was seen
INVERSE = 1e-13  # closed forms there and back, relative: 2e-14 was seen

DIFFERENCES = 1e-7
"""Central differences with a relative step of 1e-5, relative or absolute: 2e-8 was seen."""

LONG = 1e-10  # the difference of two heights of 2 km: 2e-14 was seen
FIRST_ORDER = 1e-12  # exact slopes at b = 0, relative: 5e-16 was seen
SINGLE = 1e-5  # float32 against float64, relative: 6e-7 was seen


def flown(launch, b, times=None):
    """By integration: heights at times, or (height, duration, landing speed) of a flight."""

    def floor(t, state):
        return state[0]

    floor.direction, floor.terminal = -1, times is None
    run = solve_ivp(
        lambda t, state: [state[1], -G * (1 + b * state[1] * abs(state[1]))],
        (0, 100 if times is None else times[-1]),
        [0.0, launch],
        method="DOP853",
        rtol=1e-12,
        atol=1e-14,
        t_eval=times,
        events=(lambda t, state: state[1], floor),
    )
    if times is not None:
        return run.y[0]
    return run.y_events[0][0][0], run.t_events[1][0], -run.y_events[1][0][1]


def everything(u, h, t, g, b):
    """All formulas at once: they share one compiled function."""
    return {
        "duration": Flight.duration(u, g, b),
        "launch_speed": Flight.launch_speed(t, g, b),
        "landing_speed": Flight.landing_speed(u, g, b),
        "height_reached": Flight.height_reached(u, g, b),
        "speed_to_reach": Flight.speed_to_reach(h, g, b),
        "speed_after_drop": Flight.speed_after_drop(h, g, b),
        "time_to_fall": Flight.time_to_fall(h, g, b),
        "height_after": Flight.height_after(t, u, g, b),
    }


compiled, path = jax.jit(everything), jax.jit(Flight.height_after)
slopes = jax.jit(
    jax.vmap(jax.jacfwd(everything, argnums=(0, 1, 2, 4)), in_axes=(0, 0, 0, None, None))
)


@pytest.mark.parametrize("b", [*RATES, None])
def test_flights_are_those_of_the_motion(b):
    height, duration, landing = np.array([flown(u, b or 0.0) for u in LAUNCHES]).T
    got = compiled(LAUNCHES, height, duration, np.float64(G), None if b is None else np.float64(b))
    launch = LAUNCHES if not b else np.arctan(np.sqrt(b) * LAUNCHES) / np.sqrt(b)
    wanted = {
        "duration": duration, "launch_speed": LAUNCHES, "landing_speed": landing,
        "height_reached": height, "speed_to_reach": LAUNCHES, "speed_after_drop": landing,
        "time_to_fall": duration - launch / G,
    }  # fmt: skip
    for name, value in wanted.items():
        np.testing.assert_allclose(got[name], value, rtol=INTEGRATION, err_msg=name)
    np.testing.assert_allclose(got["height_after"], 0, atol=INTEGRATION)
    # On the way up, on the way down, and below the launch.
    for launch in (0.0, 0.7, 9.0):
        times = np.linspace(0, 1 + 3 * launch / G, 40)
        got = path(times, np.float64(launch), G, b)
        wanted = flown(launch, b or 0.0, times)
        np.testing.assert_allclose(got, wanted, rtol=INTEGRATION, atol=INTEGRATION)


def test_a_long_fall_ends_at_the_terminal_speed():
    height = path(np.linspace(1e3, 1e3 + 39, 40), np.float64(2.0), G, np.float64(0.3))
    np.testing.assert_allclose(-np.diff(height), 0.3**-0.5, rtol=LONG)


def test_formulas_undo_each_other_at_any_drag():
    """From drag that rounds away to flights that end at the terminal speed."""
    u, b = np.geomspace(1e-3, 30, 50), np.geomspace(1e-20, 10, 43)

    @jax.jit
    @jax.vmap
    def back(b):
        rise = Flight.height_reached(u, G, b)
        landing = Flight.speed_after_drop(rise, G, b) / Flight.landing_speed(u, G, b)
        time = Flight.duration(u, G, b)
        return (
            Flight.launch_speed(time, G, b),
            Flight.speed_to_reach(rise, G, b),
            landing * u,
            (1 + Flight.height_after(time - Flight.time_to_fall(rise, G, b), u, G, b) - rise) * u,
        )

    for got in back(jnp.asarray(b)):
        np.testing.assert_allclose(got, np.broadcast_to(u, (43, 50)), rtol=INVERSE)


@pytest.mark.parametrize("b", RATES)
def test_slopes_are_those_of_differences(b):
    """By speed, height, time and drag, in vacuum too."""
    u, h, t = LAUNCHES + 0.2, np.array([0.1, 1.0, 2.0, 3.0]), np.array([0.04, 0.07, 0.7, 1.0])
    places = [u, h, t, np.float64(G), np.float64(b)]
    got = slopes(*places)
    # No drag is below 0; the next test has the exact slope there.
    for which, place in enumerate((0, 1, 2, 4) if b > 1e-3 else (0, 1, 2)):
        step = 1e-5 * (places[place] if place < 3 else 0.1)
        high, low = (
            compiled(*(x + s * step * (k == place) for k, x in enumerate(places))) for s in (1, -1)
        )
        for name, by in got.items():
            wanted = (np.asarray(high[name]) - np.asarray(low[name])) / (2 * step)
            np.testing.assert_allclose(by[which], wanted, DIFFERENCES, DIFFERENCES, err_msg=name)


def test_the_first_order_in_the_drag():
    """d/db at b = 0: integrals of b v|v| g along the flight in vacuum."""
    u, h, t = LAUNCHES, np.array([0.1, 1.0, 2.0, 3.0]), LAUNCHES / G / 2
    slope = slopes(u, h, t, np.float64(G), np.float64(0.0))
    got = {name: by[3] for name, by in slope.items()}
    w2 = 2 * G * h
    wanted = {
        "duration": -(u**3) / (2 * G),
        "launch_speed": (G * t / 2) ** 3 / 4,
        "landing_speed": -(u**3) / 2,
        "height_reached": -(u**4) / (4 * G),
        "speed_to_reach": w2**1.5 / 4,
        "speed_after_drop": -(w2**1.5) / 4,
        "time_to_fall": w2**1.5 / (12 * G),
        # Rising throughout: -g ∫∫ (u - g t)².
        "height_after": -((u * t) ** 2) * G / 2 + u * G**2 * t**3 / 3 - G**3 * t**4 / 12,
    }
    for name, value in wanted.items():
        np.testing.assert_allclose(got[name], value, rtol=FIRST_ORDER, err_msg=name)


@pytest.mark.parametrize("b", [0.0, 0.3])
def test_slopes_at_rest_are_those_of_vacuum(b):
    """At speed 0 and time 0 drag plays no part."""
    h, rest = np.full(4, 0.5), np.zeros(4)
    got = slopes(rest, h, rest, np.float64(G), np.float64(b))
    for name, which, wanted in (
        ("duration", 0, 2 / G), ("landing_speed", 0, 1), ("height_reached", 0, 0),
        ("launch_speed", 2, G / 2), ("height_after", 0, 0), ("height_after", 2, 0),
    ):  # fmt: skip
        np.testing.assert_allclose(got[name][which], wanted, rtol=INVERSE)
    for name in ("duration", "launch_speed", "landing_speed", "height_reached", "height_after"):
        np.testing.assert_array_equal(got[name][3], 0)


def test_nothing_of_the_air_is_computed_in_vacuum():
    one = jnp.ones(())
    traced = jax.make_jaxpr(lambda *a: everything(*a, None))(one, one, one, one)
    used = {step.primitive.name for step in traced.eqns}
    assert used <= {"mul", "div", "sqrt", "square", "sub"}, used


def test_single_precision():
    arguments = (LAUNCHES, LAUNCHES / 5, LAUNCHES / 9)
    wide = compiled(*arguments, np.float64(G), np.float64(0.3))
    single = compiled(*(np.float32(a) for a in arguments), np.float32(G), np.float32(0.3))
    for name, value in single.items():
        assert value.dtype == jnp.float32
        np.testing.assert_allclose(value, wide[name], rtol=SINGLE, atol=1e-7, err_msg=name)


@pytest.mark.parametrize("drag", [None, TABLE_TENNIS])
def test_values_and_logarithmic_slopes_of_readings(drag):
    """In double precision whatever JAX is set to, and of any length."""
    path = Flight(G, drag)
    time = np.geomspace(0.02, 2, 300)
    step = 1e-5
    with jax.enable_x64(False):
        speed, slope = path.evaluate(Flight.launch_speed, time)
        high, low = (path.evaluate(Flight.launch_speed, time * np.exp(s))[0] for s in (step, -step))
        back, _ = path.evaluate(Flight.duration, speed)
        few, _ = path.evaluate(Flight.launch_speed, time[:3])
        none, _ = path.evaluate(Flight.launch_speed, time[:0])
    assert speed.dtype == slope.dtype == np.float64
    np.testing.assert_allclose(slope, np.log(high / low) / (2 * step), rtol=DIFFERENCES)
    np.testing.assert_allclose(back, time, rtol=INVERSE)
    np.testing.assert_array_equal(few, speed[:3])
    assert none.shape == (0,)


def test_terminal_speed_balances_weight():
    speed = TABLE_TENNIS.terminal_speed(9.81)
    force = 0.5 * 1.204 * 0.5 * np.pi * 0.02**2 * speed**2
    np.testing.assert_allclose(force, 0.0027 * 9.81, rtol=1e-14)
    path = Flight(9.81, TABLE_TENNIS)
    assert path.rate == pytest.approx(speed**-2, rel=1e-15)
    assert Flight().terminal_speed == np.inf and Flight().rate is None

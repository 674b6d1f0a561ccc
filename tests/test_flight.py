"""Flight with quadratic drag, held against numerical integration of its equation of motion."""

import numpy as np
import pytest

from jaxcontact._flight import Drag, Flight
from tests.test_calibration.oracle import flown

TABLE_TENNIS = Drag(mass=0.0027, radius=0.02, coefficient=0.5)
LAUNCHES = (0.05, 0.7, 3.0, 9.0, 30.0)

INTEGRATION = 1e-9
"""DOP853 at rtol 1e-12: measured differences up to 1e-11, with room for other machines."""

INVERSE = 1e-13
"""Newton to the last digit: measured 4e-16 relative."""

DIFFERENCES = 1e-6
"""Central differences with a relative step of 1e-5: measured 1e-9 at most."""


@pytest.mark.parametrize("launch", LAUNCHES)
def test_time_height_and_landing_speed_are_those_of_the_motion(launch):
    flight = Flight(drag=TABLE_TENNIS)
    b = flight.terminal_speed**-2
    height, duration, landing = flown(launch, flight.gravity, b)
    np.testing.assert_allclose(flight.duration(launch), duration, rtol=INTEGRATION)
    np.testing.assert_allclose(flight.landing_speed(launch), landing, rtol=INTEGRATION)
    np.testing.assert_allclose(flight.speed_to_reach(height), launch, rtol=INTEGRATION)
    np.testing.assert_allclose(flight.speed_after_drop(height), landing, rtol=INTEGRATION)


@pytest.mark.parametrize("drag", [None, TABLE_TENNIS])
def test_launch_speed_undoes_duration(drag):
    flight = Flight(drag=drag)
    launch = np.geomspace(1e-4, 100, 300)
    np.testing.assert_allclose(flight.launch_speed(flight.duration(launch)), launch, rtol=INVERSE)


def test_weak_drag_is_vacuum():
    launch = np.array(LAUNCHES)
    heavy = Flight(drag=Drag(mass=1e9, radius=0.02, coefficient=0.5))
    for method in ("duration", "landing_speed", "speed_to_reach", "speed_after_drop"):
        np.testing.assert_allclose(
            getattr(heavy, method)(launch), getattr(Flight(), method)(launch), rtol=1e-9
        )


@pytest.mark.parametrize("drag", [None, TABLE_TENNIS])
def test_log_slopes_are_derivatives(drag):
    flight = Flight(drag=drag)
    duration = np.array([0.05, 0.3, 0.9, 2.0])
    step = 1e-5

    def logarithms(scale):
        launch = flight.launch_speed(duration * scale)
        return np.log(launch), np.log(flight.landing_speed(launch))

    high, low = logarithms(np.exp(step)), logarithms(np.exp(-step))
    for slope, a, b in zip(flight.log_slopes(duration), high, low, strict=True):
        np.testing.assert_allclose(slope, (a - b) / (2 * step), rtol=DIFFERENCES)


def test_terminal_speed_balances_weight():
    speed = TABLE_TENNIS.terminal_speed(9.81)
    force = 0.5 * 1.204 * 0.5 * np.pi * 0.02**2 * speed**2
    np.testing.assert_allclose(force, 0.0027 * 9.81, rtol=1e-14)
    assert Flight().terminal_speed == np.inf


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_bad_arguments_raise(bad):
    with pytest.raises(ValueError, match="gravity"):
        Flight(gravity=bad)
    for name in ("mass", "radius", "coefficient", "air_density"):
        good = {"mass": 1.0, "radius": 1.0, "coefficient": 1.0, "air_density": 1.0}
        with pytest.raises(ValueError, match=name):
            Drag(**{**good, name: bad})

"""Suspicious data are refused with a guess, and never converted silently."""

import numpy as np
import pytest

import jaxcontact as jc

SPEED = np.linspace(0.5, 3, 8)
E = np.linspace(0.9, 0.8, 8)
CONTACT = jc.Contact(mass=1.0, stiffness=1e6)

DOORS = {
    "choose_law": lambda e: jc.choose_law(CONTACT, SPEED, e),
    "fit_damping": lambda e: jc.fit_damping(CONTACT, SPEED, e),
    "fit_energy_loss": lambda e: jc.fit_energy_loss(E, e),
    "fit_impacts": lambda e: jc.fit_impacts(jc.HuGuo(e=0.8), CONTACT, SPEED, e=e),
    "read_recording": lambda e: jc.read_recording(velocity=SPEED, restitution=e),
}


@pytest.mark.parametrize("door", DOORS)
def test_percent(door):
    with pytest.raises(ValueError, match=r"90.*[pP]ercent\? [tT]hen divide by 100"):
        DOORS[door](100 * E)


@pytest.mark.parametrize("door", DOORS)
def test_one_wild_value_is_named_without_a_guess(door):
    wild = E.copy()
    wild[3] = 1.5
    with pytest.raises(ValueError, match=r"1\.5") as caught:
        DOORS[door](wild)
    assert "percent" not in str(caught.value)


@pytest.mark.parametrize("door", DOORS)
def test_noise_may_bring_e_above_one(door):
    noisy = E.copy()
    noisy[0] = 1.004
    found = DOORS[door](noisy)
    assert getattr(found, "converged", True)


def test_milliseconds():
    with pytest.raises(jc.RecordingError, match=r"in ms\? then divide by 1000"):
        jc.read_recording(interval_s=1000 * 0.8 ** np.arange(6))


def test_a_transform_that_the_problem_brings_itself():
    damping = jc.fit_damping(CONTACT, SPEED, E, power=True, transforms={"power": jc.Fixed()})
    assert damping.names == ("c",)
    with pytest.raises(ValueError, match=r"must not name what this problem .* but names c"):
        jc.fit_damping(CONTACT, SPEED, E, transforms={"c": jc.Free()})
    law = jc.HuGuo(e=0.8)
    with pytest.raises(ValueError, match=r"but names contact\.mass"):
        jc.fit_impacts(law, CONTACT, SPEED, e=E, transforms={"contact.mass": jc.Free()})
    with pytest.raises(ValueError, match="must be a dict of transforms by name"):
        jc.fit_impacts(law, CONTACT, SPEED, e=E, transforms=jc.Free())
    with pytest.raises(TypeError, match="`choose_law` has no argument `transforms`"):
        jc.choose_law(CONTACT, SPEED, E, transforms={"e": jc.Free()})


def bouncing(drop, seconds=0.5):
    times = seconds * np.tile(0.8 ** np.arange(4), 3)
    trial, bounce = np.repeat([1, 2, 3], 4), np.tile([1, 2, 3, 4], 3)
    return {"drop_height_m": drop, "trial": trial, "bounce": bounce, "interval_s": times}


@pytest.mark.parametrize(
    ("drop", "guess"),
    [
        (47.0, r"to 0\.00652 of this height .* to 0\.64 .* in cm\? then divide by 100"),
        (470.0, r"in mm\? then divide by 1000"),
        (3e4, r"to 0\.64 of the one before$"),
        (0.1, r"rise to 3\.07 of this height"),
    ],
)
def test_a_drop_height_that_the_first_flight_contradicts(drop, guess):
    with pytest.raises(jc.RecordingError, match=guess):
        jc.read_recording(**bouncing(np.full(12, drop)))


def test_bounces_before_the_recording_contradict_no_drop_height():
    """Of e = 0.8 the first two, and the drag of a light ball, make the first rise 0.3 of usual."""
    assert len(jc.read_recording(**bouncing(np.full(12, 1.5))).records) == 12


@pytest.mark.parametrize(("times", "unit"), [(100, "cm"), (1000, "mm")])
def test_rebounds_in_another_unit(times, unit):
    dropped = np.linspace(0.5, 1, 6)
    with pytest.raises(jc.RecordingError, match=f"in {unit}. then divide by {times}"):
        jc.read_recording(drop_height_m=dropped, rebound_height_m=0.6 * times * dropped)


def test_a_record_without_an_impact():
    time = np.linspace(0, 1e-3, 9)
    with pytest.raises(ValueError, match="Argument `force` must vary, but is 3 everywhere"):
        jc.fit_record(jc.HuGuo(e=0.8), CONTACT, time, 1.0, force=np.full(9, 3.0))


def test_numbers_that_the_prediction_does_not_use():
    def line(p, x):
        return p["slope"] * x + p["offsets"][0]

    start = {"slope": 1.0, "offsets": np.zeros(1), "ofset": 0.0}
    with pytest.raises(ValueError, match="does not use ofset; leave out"):
        jc.fit(line, E, start, x=SPEED)
    held = jc.fit(line, E, start, x=SPEED, transforms={"ofset": jc.Fixed()})
    assert held.converged and held.names == ("offsets[0]", "slope")


def test_numbers_of_one_name():
    start = {"a": {"b": 1.0}, "a.b": 0.0}
    with pytest.raises(ValueError, match=r"different names, but holds a\.b twice"):
        jc.fit(lambda p, x: p["a"]["b"] * x + p["a.b"], E, start, x=SPEED)

"""Data that are not what they seem are refused with a guess, and never converted in silence."""

import numpy as np
import pytest

import jaxcontact as jc

SPEED = np.linspace(0.5, 3, 8)
E = np.linspace(0.9, 0.8, 8)
CONTACT = jc.Contact(mass=1.0, stiffness=1e6)

DOORS = {
    "choose_law": lambda e: jc.choose_law(SPEED, e, CONTACT),
    "fit_damping": lambda e: jc.fit_damping(SPEED, e, CONTACT),
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
    damping = jc.fit_damping(SPEED, E, CONTACT, form="power", transforms={"power": jc.Fixed()})
    assert damping.names == ("c",)
    with pytest.raises(ValueError, match=r"must not name what this problem .* but names c"):
        jc.fit_damping(SPEED, E, CONTACT, transforms={"c": jc.Free()})
    law = jc.HuGuo(e=0.8)
    with pytest.raises(ValueError, match=r"but names contact\.mass"):
        jc.fit_impacts(law, CONTACT, SPEED, e=E, transforms={"contact.mass": jc.Free()})
    with pytest.raises(ValueError, match="must be a dict of transforms by name"):
        jc.fit_impacts(law, CONTACT, SPEED, e=E, transforms=jc.Free())
    with pytest.raises(ValueError, match="Argument `transforms` must be None: each law"):
        jc.choose_law(SPEED, E, CONTACT, transforms={"e": jc.Free()})

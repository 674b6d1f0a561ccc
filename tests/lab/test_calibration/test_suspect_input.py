"""Suspicious data are refused with a guess, and never converted silently.

Ready-made fits take law, contact, then data, and the keywords of `fit` by their names.
"""

import inspect

import numpy as np
import pytest

import jaxcontact as jc

SPEED = np.linspace(0.5, 3, 8)
E = np.linspace(0.9, 0.8, 8)
LAW = jc.HuGuo(e=0.8)
CONTACT = jc.Contact(mass=1.0, stiffness=1e6)

DOORS = {
    "choose_law": lambda e: jc.choose_law(CONTACT, SPEED, e),
    "fit_damping": lambda e: jc.fit_damping(CONTACT, SPEED, e),
    "fit_energy_loss": lambda e: jc.fit_energy_loss(E, e),
    "fit_impacts": lambda e: jc.fit_impacts(LAW, CONTACT, SPEED, e=e),
    "read_recording": lambda e: jc.read_recording(velocity=SPEED, restitution=e),
}


@pytest.mark.parametrize("door", DOORS)
def test_percent_a_wild_value_and_noise_above_one(door):
    with pytest.raises(ValueError, match=r"90.*[pP]ercent\? [tT]hen divide by 100"):
        DOORS[door](100 * E)
    odd = E.copy()
    odd[3] = 1.5
    with pytest.raises(ValueError, match=r"1\.5") as caught:
        DOORS[door](odd)
    assert "percent" not in str(caught.value)
    odd[3] = 1.004
    assert getattr(DOORS[door](odd), "converged", True)


def bouncing(drop, seconds=0.5):
    times = seconds * np.tile(0.8 ** np.arange(4), 3)
    trial, bounce = np.repeat([1, 2, 3], 4), np.tile([1, 2, 3, 4], 3)
    drop = np.full(12, drop)
    return {"drop_height_m": drop, "trial": trial, "bounce": bounce, "interval_s": times}


DROPPED = np.linspace(0.5, 1, 6)


def rebounding(scale):
    return {"drop_height_m": DROPPED, "rebound_height_m": 0.6 * scale * DROPPED}


@pytest.mark.parametrize(
    ("columns", "guess"),
    [
        ({"interval_s": 1000 * 0.8 ** np.arange(6)}, r"in ms\? then divide by 1000"),
        (bouncing(47.0), r"to 0\.00652 of this height .* to 0\.64 .* in cm\? then divide by 100"),
        (bouncing(470.0), r"in mm\? then divide by 1000"),
        (bouncing(3e4), r"to 0\.64 of the one before$"),
        (bouncing(0.1), r"rise to 3\.07 of this height"),
        (rebounding(100), "in cm. then divide by 100"),
        (rebounding(1000), "in mm. then divide by 1000"),
    ],
)
def test_a_column_in_another_unit(columns, guess):
    with pytest.raises(jc.RecordingError, match=guess):
        jc.read_recording(**columns)


def test_bounces_before_the_recording_contradict_no_drop_height():
    """Of e = 0.8 the first two, and the drag of a light ball, make the first rise 0.3 of usual."""
    assert len(jc.read_recording(**bouncing(1.5)).records) == 12


def line(p, x):
    return p["slope"] * x + p["offsets"][0]


START = {"slope": 1.0, "offsets": np.zeros(1), "ofset": 0.0}
TIME, FIRST, SECOND = np.linspace(0, 1e-3, 150), np.array([0.5, 0.4]), np.array([0.45, 0.36])


def bounces(first=FIRST, second=SECOND, **how):
    jc.fit_bounces(jc.ExactRestitution(e=0.9), CONTACT, first, second, **how)


def impacts(**how):
    jc.fit_impacts(LAW, CONTACT, SPEED, **how)


def record(**how):
    jc.fit_record(LAW, CONTACT, TIME, 1.0, **how)


def choose(contact=CONTACT, velocity=SPEED, e=E, **how):
    jc.choose_law(contact, velocity, e, **how)


def design(sigma=("e", "duration"), **how):
    sigma = dict.fromkeys(sigma, 0.01) if isinstance(sigma, tuple) else sigma
    law = jc.ConstantDamping(c=2e5)
    jc.design(law, CONTACT, **{"sigma": sigma, "candidates": SPEED, "readings": 4} | how)


EACH, OUT = np.ones(150), jc.ExactRestitution(e=0.8)
LONG, SLOW = np.linspace(0, 1, 4500), jc.LowPass(100.0)
REFUSED = [
    (bounces, {"second": [0.5, -0.1]}, "`second` must be in .* is -0.1 at point 1"),
    (bounces, {"first": 1600 * FIRST, "second": 1600 * SECOND}, "are they in ms. then divide by"),
    (record, {}, "`force` or `indentation` must be given"),
    (record, {"force": np.full(150, 3.0)}, "Argument `force` must vary, but is 3 everywhere"),
    (record, {"force": EACH, "indentation": EACH, "sigma_force": 1.0}, "for both columns or for"),
    (record, {"indentation": TIME, "low_pass_force": SLOW}, "must be None without `force`"),
    (jc.LowPass, {"cutoff": 100.0, "order": 9}, "`order` must be at most 8, but is 9"),
    (
        lambda **how: jc.fit_record(LAW, CONTACT, LONG, 1.0, force=LONG, **how),
        *({"low_pass_force": SLOW}, r"at most 2000 readings .* give every 3rd"),
    ),
    (impacts, {}, "`e` or `duration` or `max_force` must be given"),
    (impacts, {"e": E, "fixed": ("c",)}, r"`fixed` must name .* the contact \(law.e, contact.mass"),
    (impacts, {"e": E, "duration": E, "sigma_e": 0.1}, "for both columns or for none"),
    (impacts, {"e": E, "transforms": {"contact.mass": jc.Free()}}, r"but names contact\.mass"),
    (impacts, {"e": E, "transforms": jc.Free()}, "must be a dict of transforms by name"),
    (choose, {"sigma_duration": 0.1}, "`sigma_duration` must be None without `duration`"),
    (choose, {"duration": SPEED, "sigma": 0.1}, "`sigma_duration` is None"),
    (choose, {"duration": SPEED, "sigma_duration": 0.1}, "`sigma` is None"),
    (choose, {"max_force": SPEED, "weights": 1.0}, "`weights` must be None with `max_force`"),
    (choose, {"max_force": -SPEED}, "`max_force` must be in"),
    (choose, {"velocity": SPEED[:4], "e": E[:4], "laws": "bridges"}, "too few to compare constant"),
    (design, {"sigma": ("e",)}, "{'e': 0.01} does not determine law.c, contact.stiffness"),
    (design, {"readings": 1}, r"must be at least the number of parameters, 2 \(law.c, contact.st"),
    (design, {"sigma": ("speed",)}, "to some of e, duration, max_force, but is"),
    (design, {"sigma": {"e": -1.0}}, r'`sigma\["e"\]` must be a number in'),
    (design, {"candidates": [1.0, -1.0]}, "`candidates` must be in .* but is -1 at point 1"),
    (design, {"goal": OUT, "fixed": ("speed",)}, "but holds 'speed'"),
    (
        lambda **how: jc.fit_damping(CONTACT, [1.0, -1.0], [0.5, 0.5], **how),
        *({}, "`velocity` must be in"),
    ),
    (
        lambda **how: jc.fit_damping(CONTACT, SPEED, E, **how),
        *({"transforms": {"c": jc.Free()}}, r"must not name what this problem .* but names c"),
    ),
    (
        lambda **how: jc.fit_energy_loss(E, **how),
        *({"transforms": {"beta": jc.Free()}}, "must not name what this problem .* names beta"),
    ),
    (lambda: jc.fit(line, E, START, x=SPEED), {}, "does not use ofset; leave out"),
    (
        lambda: jc.fit(line, E, {"a": {"b": 1.0}, "a.b": 0.0}, x=SPEED),
        *({}, r"different names, but holds a\.b twice"),
    ),
]


@pytest.mark.parametrize(("call", "how", "message"), REFUSED)
def test_what_does_not_go_together_is_refused(call, how, message):
    with pytest.raises(ValueError, match=message):
        call(**how)


def test_transforms_of_ones_own():
    damping = jc.fit_damping(CONTACT, SPEED, E, power=True, transforms={"power": jc.Fixed()})
    assert damping.names == ("c",)
    held = jc.fit(line, E, START, x=SPEED, transforms={"ofset": jc.Fixed()})
    assert held.converged and held.names == ("offsets[0]", "slope")
    with pytest.raises(TypeError, match="`choose_law` has no argument `transforms`"):
        jc.choose_law(CONTACT, SPEED, E, transforms={"e": jc.Free()})


READY = (
    *(jc.choose_friction, jc.choose_law, jc.fit_bounces, jc.fit_damping, jc.fit_energy_loss),
    *(jc.fit_impacts, jc.fit_oblique, jc.fit_record, jc.learn_law),
)
OF_FIT = inspect.signature(jc.fit).parameters
CHOICES = {jc.choose_law: set(), jc.choose_friction: {"groups", "weights"}}
OWN_SIGMA = {*CHOICES, jc.fit_impacts, jc.fit_oblique, jc.fit_record}
OWN_NOISE = {jc.choose_friction, jc.fit_oblique, jc.fit_record}
LEFT = {"predict", "data", "start", "x"}


@pytest.mark.parametrize("function", READY)
def test_signatures_show_what_fit_takes(function):
    shown = inspect.signature(function).parameters
    assert all(one.kind is not one.VAR_KEYWORD for one in shown.values())
    missing = OF_FIT.keys() - shown.keys() - LEFT - ({"sigma"} if function in OWN_SIGMA else set())
    # A choice fits many laws: one that fails is flagged.
    of_one = {"correlation", "transforms", "throw"}
    assert missing == (of_one | CHOICES[function] if function in CHOICES else set())
    for name in OF_FIT.keys() & shown.keys() - LEFT:
        own = name == "noise" and function in OWN_NOISE
        wanted = None if own else OF_FIT[name].default
        assert shown[name].default == wanted and shown[name].kind is inspect.Parameter.KEYWORD_ONLY


@pytest.mark.parametrize("function", READY)
def test_an_unknown_keyword_fails_by_name(function):
    wrong = rf"`{function.__name__}` has no argument `strats`\. Did you mean 'starts'\?"
    with pytest.raises(TypeError, match=wrong):
        function(strats=3)

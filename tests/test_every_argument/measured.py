"""Laws from measurements, and the recordings they come from."""

import dataclasses
import functools
import types

import jaxcontact as jc
from tests.test_every_argument.case import (
    COLUMN,
    CONTACTS,
    COUNT,
    EMPTY,
    LAWS,
    METHODS,
    NOTHING,
    NUMBERS_3,
    OUT,
    SEED,
    SWITCH,
    TRACK,
    Case,
    V,
    blank,
    reached,
)
from tests.test_every_argument.fits import a_fit
from tests.test_every_argument.kinds import (
    CONTACT,
    FLAG,
    INSIDE,
    LAW,
    NONE,
    POSITIVE,
    POSITIVES,
    REAL,
    TEXT,
    E,
)

DESIGNED = {"e": 0.1, "duration": 0.1, "max_force": 0.1}
MEASURED = jc.read_recording(velocity=V, restitution=OUT)
RECORD = [*[0.0] * 30, *(k * (30 - k) for k in range(30)), *[0.0] * 30]
LIST_OF_NUMBERS = frozenset({"tuple", "list of text", "shape (1,)", "jax shape (1,)", "Series"})
"""Text may be a number there, as it is in a file."""
AT = frozenset({"shape (1,)", "jax shape (1,)", "shape (0,)", "empty list"})
HOW = {"contact": CONTACT, "velocity": V, "e": OUT}
CLASSES = frozenset({"class", "law class"})
"""They are functions, which are called with a stage here."""
RECORDED = {"velocity": V, "restitution": OUT}


def _choice():
    empty = {f.name: None for f in dataclasses.fields(jc.LawChoice)}
    there = {
        "fits": {"constant e": a_fit()},
        "laws": (),
        "_kinds": (types.SimpleNamespace(name="constant e", law_of=reached, moved=reached),),
        "best": "constant e",
        "contact": CONTACT,
        "reference": 1.0,
    }
    return jc.LawChoice(**empty | there)


@functools.cache
def cases() -> dict[str, Case]:
    return {
        "fit_damping": Case(
            jc.fit_damping,
            HOW,
            {
                "contact": CONTACTS,
                "velocity": COLUMN,
                "e": COLUMN,
                "power": SWITCH,
                "method": METHODS,
                "sigma": POSITIVE | NONE,
            },
        ),
        "fit_energy_loss": Case(
            jc.fit_energy_loss,
            {"e_in": OUT},
            {
                "e_in": NUMBERS_3 & {"Series"} | {"shape (1,)", "jax shape (1,)"},
                "e_out": NONE,
                "degree": SEED | NONE,
                "contact": CONTACTS | NONE,
                "method": METHODS,
            },
        ),
        "learn_law": Case(
            jc.learn_law,
            {"e_in": OUT},
            {
                "e_in": NUMBERS_3 & {"Series"} | {"shape (1,)", "jax shape (1,)"},
                "e_out": NONE,
                "shape": NOTHING,
                "contact": CONTACTS | NONE,
                "method": METHODS,
            },
        ),
        "fit_impacts": Case(
            jc.fit_impacts,
            {"law": LAW, "contact": CONTACT, "velocity": V, "e": OUT, "duration": OUT},
            {
                "law": LAWS,
                "contact": CONTACTS,
                "velocity": COLUMN,
                "e": NONE,
                "duration": NONE,
                "fixed": EMPTY,
                "method": METHODS,
            },
        ),
        "fit_impacts, one column": Case(
            jc.fit_impacts,
            {"law": LAW, "contact": CONTACT, "velocity": V, "e": OUT},
            {"sigma_e": POSITIVE | NONE},
        ),
        "fit_impacts, the other column": Case(
            jc.fit_impacts,
            {"law": LAW, "contact": CONTACT, "velocity": V, "duration": OUT},
            {"sigma_duration": POSITIVE | NONE},
        ),
        "fit_impacts, peak forces": Case(
            jc.fit_impacts,
            {"law": LAW, "contact": CONTACT, "velocity": V, "max_force": OUT},
            {"sigma_max_force": POSITIVE | NONE, "max_force": NOTHING},
        ),
        "design": Case(
            jc.design,
            {"law": LAW, "contact": CONTACT, "sigma": DESIGNED, "candidates": V},
            {
                "law": LAWS,
                "contact": CONTACTS,
                "sigma": NOTHING,
                "candidates": NUMBERS_3 - {"range"} | {"shape (1,)", "jax shape (1,)"},
                "readings": COUNT,
                "goal": {"law"},
                "fixed": EMPTY,
                "method": METHODS,
            },
        ),
        "Design.readings_for": Case(
            jc.Design(V, ("e",) * len(V), noncentrality=1.0).readings_for,
            {},
            {"noncentrality": POSITIVE},
        ),
        "fit_bounces": Case(
            jc.fit_bounces,
            {"law": LAW, "contact": CONTACT, "first": V, "second": OUT},
            {
                "law": LAWS,
                "contact": CONTACTS,
                "first": COLUMN,
                "second": COLUMN,
                "kind": NOTHING,
                "gravity": POSITIVE,
                "drag": NONE,
                "fixed": EMPTY,
                "method": METHODS,
            },
        ),
        "fit_record": Case(
            jc.fit_record,
            {"law": LAW, "contact": CONTACT, "time": V, "velocity": 1.0, "force": OUT},
            {
                "law": LAWS,
                "contact": CONTACTS,
                "time": COLUMN,
                "velocity": POSITIVE,
                "force": NOTHING,
                "indentation": NONE,
                "sigma_force": POSITIVE | NONE,
                "low_pass_force": NONE,
                "start_time": REAL | NONE,
                "fixed": EMPTY,
            },
        ),
        "fit_record, indentation": Case(
            jc.fit_record,
            {"law": LAW, "contact": CONTACT, "time": V, "velocity": 1.0, "indentation": OUT},
            {"sigma_indentation": POSITIVE | NONE, "low_pass_indentation": NONE},
        ),
        "LowPass": Case(jc.LowPass, {"cutoff": 100.0}, {"cutoff": POSITIVES, "order": COUNT}),
        "fit_velocity_profile": Case(
            jc.fit_velocity_profile,
            {"indentation": V - V[0], "velocity": V[::-1] - V[0]},
            {
                "indentation": COLUMN,
                "velocity": COLUMN,
                "weights": NONE,
                "squared": SWITCH,
                "start": POSITIVE,
            },
        ),
        "choose_law": Case(
            jc.choose_law,
            HOW,
            {
                "contact": CONTACTS,
                "velocity": COLUMN,
                "e": COLUMN,
                "laws": NOTHING,
                "sigma": POSITIVE | NONE,
                "weights": POSITIVE | NONE,
                "groups": NONE,
                "mark_outliers": SWITCH,
                "duration": NONE,
                "max_force": NONE,
                "sigma_duration": NONE,
                "sigma_max_force": NONE,
            },
        ),
        "choose_law, stages": Case(
            jc.choose_law, HOW, {"progress": FLAG | NONE | {"function"}}, untested=CLASSES
        ),
        "choose_law, contact times": Case(
            jc.choose_law,
            HOW | {"duration": OUT, "max_force": OUT},
            {"duration": NONE, "max_force": NONE},
        ),
        "choose_law, contact times with known noise": Case(
            jc.choose_law,
            HOW | {"duration": OUT, "sigma": 0.1, "sigma_duration": 0.1},
            {"sigma": POSITIVE, "sigma_duration": POSITIVE},
        ),
        "LawChoice.law": Case(_choice().law, {}, {"kind": NONE}),
        "LawChoice.contact_of": Case(_choice().contact_of, {}, {"kind": NONE}),
        "LawChoice.law_fit": Case(_choice().law_fit, {}, {"kind": NOTHING}),
        "LawChoice.curve": Case(
            _choice().curve,
            {"kind": "constant e", "speeds": V},
            {"kind": NOTHING, "speeds": NUMBERS_3 - {"range"} | {"shape (1,)", "jax shape (1,)"}},
        ),
        "calibrate": Case(
            jc.calibrate,
            {"recording": MEASURED},
            {
                "recording": NOTHING,
                "laws": NOTHING,
                "drag": NONE,
                "mass": POSITIVE | NONE,
                "stiffness": POSITIVE | NONE,
                "exponent": NONE,
                "gravity": POSITIVE,
                "at": NUMBERS_3 - {"range"} | POSITIVE | AT,
                "progress": FLAG | NONE | {"function"},
            },
            untested=CLASSES,
        ),
        "Calibration.save": Case(blank(jc.Calibration).save, {}, {"path": TEXT - {"empty text"}}),
        "load_calibration": Case(jc.load_calibration, {}, {"path": TEXT - {"empty text"}}),
        "Drag": Case(
            jc.Drag,
            {"mass": 1.0, "radius": 1.0, "coefficient": 0.5},
            dict.fromkeys(("mass", "radius", "coefficient", "air_density"), POSITIVE),
        ),
        "Drag.terminal_speed": Case(
            jc.Drag(1.0, 1.0, 1.0).terminal_speed, {}, {"gravity": POSITIVE}
        ),
        "Rational": Case(jc.Rational, {}, {"degree": COUNT}),
        "Rational.law": Case(jc.Rational().law, {}, {"e": E}, staged=True),
        "Spline": Case(jc.Spline, {}, {"intervals": COUNT, "low": INSIDE | {"zero"}}),
        "Spline.law": Case(jc.Spline().law, {}, {"e": E}, staged=True),
        "Network": Case(jc.Network, {}, {"width": COUNT, "seed": SEED}),
        "read_recording": Case(
            jc.read_recording,
            {},
            {
                "source": NONE,
                "layout": NONE,
                "ball": NONE,
                "columns": NONE,
                "decimal": NONE,
                "rate": NONE,
                "sheet": NONE,
            },
        ),
        "read_recording, record": Case(
            jc.read_recording,
            {"force": RECORD, "rate": 1000.0},
            {"force": NOTHING, "rate": NOTHING},
        ),
        "read_recording, track": Case(
            jc.read_recording,
            {"frame": list(range(40)), "y": TRACK, "rate": 60.0},
            {"frame": NOTHING, "y": NOTHING, "rate": COUNT},
        ),
        "read_recording, columns": Case(
            jc.read_recording, RECORDED, {"velocity": NOTHING, "restitution": NOTHING}
        ),
        "read_recording, column of intervals": Case(
            jc.read_recording,
            {"interval_s": V[::-1]},
            # No ball has growing intervals.
            {"interval_s": LIST_OF_NUMBERS - {"tuple", "Series"}, "ball": NONE | {"empty text"}},
        ),
    }

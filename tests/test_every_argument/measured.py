"""Laws from measurements, and the recordings they come from."""

import dataclasses
import functools
import types

import jaxcontact as jc
from tests.test_every_argument.case import OUT, RECORD, TRACK, V, blank, case, method, reached
from tests.test_every_argument.fits import a_fit
from tests.test_every_argument.kinds import CONTACT, LAW

MEASURED = jc.read_recording(velocity=V, restitution=OUT)
DESIGN = jc.Design(V, ("e",) * len(V), noncentrality=1.0)
IMPACTS = {"law": LAW, "velocity": V}
RECORDED = {"law": LAW, "time": V}
HOW = {"velocity": V, "e": OUT}
COLUMN = "Series or ONE"
SPEEDS = "tuple or Series or ONE"
STAGES = "FLAG or None or function"
CLASSES = "class or law class"  # other functions are called with a stage


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
def cases():
    choice = _choice()
    return [
        case("fit_damping", "NOTHING: velocity; FLAG: power; POSITIVE or None: sigma", **HOW),
        case("fit_energy_loss", f"{COLUMN}: e_in; SEED or None: degree"),
        case("learn_law", f"{COLUMN}: e_in"),
        case(
            "fit_impacts",
            "NOTHING: velocity; None: duration",
            apart="sigma_e sigma_duration sigma_max_force max_force",
            **IMPACTS | {"e": OUT, "duration": OUT},
        ),
        *(
            case(
                f"fit_impacts, {name} alone",
                f"POSITIVE or None: sigma_{name}; NOTHING: {name}",
                **IMPACTS | {name: OUT},
            )
            for name in ("e", "duration", "max_force")
        ),
        case(
            "design",
            f"NOTHING: sigma; {SPEEDS}: candidates; WHOLE: readings; law: goal",
            law=LAW,
            sigma=dict.fromkeys(("e", "duration", "max_force"), 0.1),
            candidates=V[:3],
        ),
        method(DESIGN, "readings_for", "POSITIVE: noncentrality"),
        case("fit_bounces", "POSITIVE: gravity", law=LAW, first=V, second=OUT),
        case(
            "fit_record",
            "NOTHING: force; POSITIVE: velocity; None: indentation; "
            "POSITIVE or None: sigma_force; REAL or None: start_time",
            **RECORDED,
            force=OUT,
        ),
        case(
            "fit_record, indentation",
            "POSITIVE or None: sigma_indentation; None: low_pass_indentation",
            **RECORDED,
            indentation=OUT,
        ),
        case("LowPass", "POSITIVES: cutoff; WHOLE: order", cutoff=100.0),
        case(
            "fit_velocity_profile",
            "NOTHING: indentation velocity; None: weights; FLAG: squared; POSITIVE: start",
            indentation=V - V[0],
            velocity=V[::-1] - V[0],
        ),
        case(
            "choose_law",
            "NOTHING: velocity; POSITIVE or None: sigma weights; None: groups duration; "
            "FLAG: mark_outliers",
            **HOW,
        ),
        case("choose_law, stages", f"{STAGES}: progress", untested=CLASSES, **HOW),
        case(
            "choose_law, contact times",
            "None: duration max_force",
            **HOW | dict.fromkeys(("duration", "max_force"), OUT),
        ),
        case(
            "choose_law, contact times with known noise",
            "POSITIVE: sigma sigma_duration",
            **HOW | {"duration": OUT, "sigma": 0.1, "sigma_duration": 0.1},
        ),
        *(method(choice, name) for name in ("law", "contact_of")),
        method(choice, "law_fit"),
        method(choice, "curve", f"{SPEEDS}: speeds", kind="constant e", speeds=V),
        case(
            "calibrate",
            f"{SPEEDS} or POSITIVE or shape (0,) or empty list: at; None: exponent; "
            f"POSITIVE: gravity; POSITIVE or None: mass stiffness; {STAGES}: progress",
            untested=CLASSES,
            recording=MEASURED,
        ),
        method(blank(jc.Calibration), "save"),
        case("load_calibration"),
        case("Drag", "POSITIVE: mass radius coefficient air_density", coefficient=0.5),
        method(jc.Drag(1.0, 1.0, 1.0), "terminal_speed", "POSITIVE: gravity"),
        case("Rational", "WHOLE: degree"),
        case("Spline", "WHOLE: intervals; INSIDE or zero: low"),
        case("Network", "WHOLE: width; SEED: seed"),
        *(method(shape, "law", "E: e", staged=True) for shape in (jc.Rational(), jc.Spline())),
        case("read_recording"),
        case("read_recording, record", "NOTHING: force rate", force=RECORD, rate=1000.0),
        case(
            "read_recording, track",
            "NOTHING: frame y; WHOLE: rate",
            frame=[*range(40)],
            y=TRACK,
            rate=60.0,
        ),
        case(
            "read_recording, columns", "NOTHING: velocity restitution", velocity=V, restitution=OUT
        ),
        # Text may be a number, as it is in a file. No ball has growing intervals.
        case(
            "read_recording, column of intervals",
            "list of text or ONE: interval_s; None or empty text: ball",
            interval_s=V[::-1],
        ),
    ]

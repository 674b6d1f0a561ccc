"""Sweeps, exports and pictures."""

import dataclasses
import functools
import pathlib
import tempfile

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxcontact as jc
from jaxcontact._export.at_time_step import Scheme
from jaxcontact._lab.sound import Envelope, Sound
from tests.test_every_argument.case import (
    CONTACTS,
    EMPTY,
    LAWS,
    NOTHING,
    NUMBERS_3,
    PROGRESS,
    TRACK,
    UNSOLVED,
    Case,
    blank,
)
from tests.test_every_argument.fits import a_fit
from tests.test_every_argument.kinds import (
    ARRAYS,
    CALLABLE,
    CONTACT,
    INSIDE,
    KINDS,
    LAW,
    NONE,
    POSITIVE,
    TEXT,
    WHOLE,
)
from tests.test_every_argument.physics import IMPACT_LEGAL

_FOLDER = tempfile.TemporaryDirectory()
_PICTURE = pathlib.Path(_FOLDER.name) / "picture.png"


def _doubled(e):
    return 2 * e


_SWEPT = ARRAYS - {"empty list", "shape (0,)", "shape (2, 3)", "DataFrame"} | INSIDE
_NOT_SWEPT = frozenset(
    {"empty list", "ragged", "list of text", "list of None", "shape (0,)", "shape (2, 3)"}
    | {"masked", "masked 0-d", "array of text", "array of objects", "structured", "Decimal"}
    | {"Fraction", "complex", "numpy complex", "long double", "array of complex", "jax key"}
    | {"array of long doubles", "array of dates", "jax complex", "datetime64", "timedelta64"}
)
"""Kinds that are no numbers for an axis; all else is passed on to the function as it is."""


SPEEDS = POSITIVE | {"tuple", "range", "shape (1,)", "jax shape (1,)", "with nan", "Series"}
"""One speed, or several; that an impact among them is bad is known when it is solved."""


def _path():
    zeros = jnp.zeros(3)
    energy = None
    return jc.Trajectory(zeros, zeros, zeros, zeros, energy, jnp.asarray(0))


def _heard():
    envelope = Envelope(0.1, np.ones(9), np.ones(9))
    sound = Sound("WAV", 0.9, 1, (), (), envelope)
    return dataclasses.replace(jc.read_recording(interval_s=[0.4]), sound=sound)


RECORD = [*[0.0] * 30, *(k * (30 - k) for k in range(30)), *[0.0] * 30]


def _table():
    return jc.sweep(lambda e: 2 * e, e=np.linspace(0, 1, 3))


@functools.cache
def cases() -> dict[str, Case]:
    fitted = a_fit()
    return {
        # To other simulators
        "mjx.time_step": Case(
            jc.mjx.time_step,
            {"law": UNSOLVED, "contact": CONTACT, "velocity": 1.0},
            IMPACT_LEGAL
            | {"velocity": SPEEDS - {"with nan", "range"}, "error": INSIDE, "substeps": WHOLE},
        ),
        "export": Case(
            jc.export,
            {"law": UNSOLVED, "contact": CONTACT, "velocity": 1.0, "engine": "drake"},
            IMPACT_LEGAL | {"velocity": SPEEDS, "engine": NOTHING},
        ),
        "export, lammps": Case(
            jc.export,
            {"law": LAW, "contact": CONTACT, "velocity": 1.0, "engine": "lammps", "radius": 1.0},
            {"radius": POSITIVE, "damping": NONE},
        ),
        "export, simbody": Case(
            jc.export,
            {"law": LAW, "contact": CONTACT, "velocity": 1.0, "engine": "simbody"},
            {"radius": POSITIVE},
        ),
        "export, yade": Case(
            jc.export,
            {"law": LAW, "contact": CONTACT, "velocity": 1.0, "engine": "yade", "radius": 1.0},
            {"poisson_ratio": INSIDE | NONE | {"zero"}},
        ),
        "Export.holds": Case(
            jc.export(LAW, CONTACT, 1.0, engine="exudyn").holds, {}, {"within": POSITIVE}
        ),
        "Export.at_time_step": Case(
            dataclasses.replace(
                jc.export(LAW, CONTACT, 1.0, engine="exudyn"),
                law=UNSOLVED,
                scheme=Scheme.SEMI_IMPLICIT,
            ).at_time_step,
            {"time_step": 1e-3},
            {"time_step": POSITIVE, "within": POSITIVE},
        ),
        "export, drake": Case(
            jc.export,
            {"law": LAW, "contact": CONTACT, "velocity": 1.0, "engine": "drake"},
            {"discrete_contact_approximation": NONE},
        ),
        "export, exudyn": Case(
            jc.export,
            {"law": LAW, "contact": CONTACT, "velocity": 1.0, "engine": "exudyn"},
            {"impact_model": NONE | {"zero"}},
        ),
        "export, adams": Case(
            jc.export,
            {"law": LAW, "contact": CONTACT, "velocity": 1.0, "engine": "adams"},
            {"d": POSITIVE | NONE, "length": NONE},
        ),
        # Pictures
        "plot.trajectory": Case(
            jc.plot.trajectory,
            {"path": _path(), "ax": plt.figure().add_subplot()},
            {"path": NOTHING, "x": NOTHING, "y": NOTHING, "ax": NONE, "label": TEXT | NONE},
        ),
        "plot.law": Case(
            jc.plot.law,
            {"law": UNSOLVED, "contact": CONTACT, "velocity": 1.0},
            {
                "law": LAWS,
                "contact": CONTACTS | NONE,
                "velocity": POSITIVE | NONE,
                "ax": NONE,
                "label": TEXT | NONE,
            },
        ),
        "plot.impact": Case(
            jc.plot.impact,
            {"path": _path(), "ax": plt.figure().subplots(1, 3)},
            {"path": NOTHING, "hit": NONE, "ax": NONE, "label": TEXT | NONE},
        ),
        "plot.save": Case(
            jc.plot.save,
            {"ax": plt.figure().add_subplot(), "file": _PICTURE},
            {"ax": NOTHING, "file": NOTHING, "dpi": NOTHING},
        ),
        "report": Case(
            jc.report,
            {"calibration": blank(jc.Calibration), "file": "page.html"},
            {
                "calibration": NOTHING,
                "file": NOTHING,
                "radius": POSITIVE | NONE,
                "progress": PROGRESS | NONE,
            },
        ),
        "plot.fit": Case(
            jc.plot.fit,
            {"result": fitted, "ax": plt.figure().add_subplot()},
            {
                "result": NOTHING,
                "x": NUMBERS_3 | NONE | {"shape (1,)", "jax shape (1,)", "with nan"},
                "level": INSIDE,
                "ax": NONE,
            },
        ),
        "plot.residuals": Case(
            jc.plot.residuals, {"result": fitted}, {"result": NOTHING, "ax": NONE}
        ),
        "plot.profile": Case(
            jc.plot.profile,
            {"result": fitted, "names": ["a", "b"]},
            {"result": NOTHING, "names": NONE, "level": INSIDE, "ax": NONE},
        ),
        "plot.corner": Case(
            jc.plot.corner,
            {"result": fitted, "ax": plt.figure().subplots(2, 2)},
            {"result": NOTHING, "names": NONE, "level": INSIDE, "ax": NONE},
        ),
        "sweep": Case(
            jc.sweep,
            {"fn": _doubled, "e": np.linspace(0, 1, 3), "progress": False},
            {
                "fn": frozenset({"function"}),
                "samples": NONE,
                "batch_size": WHOLE | NONE,
                "store": TEXT - {"empty text"} | NONE,
                "mesh": NONE,
                "reduce": NONE,
                "cost": NONE,
                "progress": PROGRESS | NONE,
            },
            untested=CALLABLE,
        ),
        "sweep, axis": Case(
            jc.sweep,
            {"fn": _doubled, "e": 0.5, "progress": False},
            {"e": _SWEPT},
            untested=frozenset(KINDS) - _SWEPT - _NOT_SWEPT,
        ),
        "Sweep.select": Case(_table().select, {"e": 0.5}, {"e": INSIDE | {"zero"}, "method": NONE}),
        "Sweep.to_csv": Case(_table().to_csv, {}, {"path": TEXT - {"empty text"}}),
        "plot.sweep": Case(
            jc.plot.sweep,
            {"table": _table(), "ax": plt.figure().add_subplot()},
            {"table": NOTHING, "field": NONE, "x": NONE, "ax": NONE},
        ),
        "plot.calibration": Case(
            jc.plot.calibration, {"result": blank(jc.Calibration)}, {"result": NOTHING, "ax": NONE}
        ),
        "plot.sound": Case(
            jc.plot.sound, {"recording": _heard()}, {"recording": NOTHING, "ax": NONE}
        ),
        "plot.track": Case(
            jc.plot.track,
            {"recording": jc.read_recording(time=np.arange(40) / 60, y=TRACK)},
            {"recording": NOTHING, "ax": NONE},
        ),
        "plot.record": Case(
            jc.plot.record,
            {"recording": jc.read_recording(force=RECORD, rate=1e3)},
            {"recording": NOTHING, "ax": NONE},
        ),
        "plot.choice": Case(
            jc.plot.choice, {"result": blank(jc.LawChoice)}, {"result": NOTHING, "ax": NONE}
        ),
        "paper.markdown": Case(jc.paper.markdown, {}, {"table": EMPTY}),
    }

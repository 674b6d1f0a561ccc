"""Sweeps, exports and pictures."""

import dataclasses
import functools

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxcontact as jc
from jaxcontact.engines.at_time_step import Scheme
from jaxcontact.lab.sound.audio import Envelope, Sound
from tests.test_every_argument.case import RECORD, TRACK, UNSOLVED, blank, case, method
from tests.test_every_argument.fits import a_fit
from tests.test_every_argument.kinds import CONTACT, KINDS, LAW, kinds_of


def _doubled(e):
    return 2 * e


_SWEPT = "ARRAYS or INSIDE but empty list or shape (0,) or shape (2, 3) or DataFrame"
_NO_NUMBERS = (
    "empty list or ragged or list of text or list of None or shape (0,) or shape (2, 3) or masked"
    " or masked 0-d or array of text or array of objects or structured or Decimal or Fraction"
    " or complex or numpy complex or long double or array of complex or jax key or jax complex"
    " or array of long doubles or array of dates or datetime64 or timedelta64"
)
"""Kinds that are no numbers for an axis; all else is passed on to the function as it is."""


# That an impact among several speeds is bad is known when it is solved.
SPEEDS = "POSITIVE or THREE or ONE or with nan"
GIVEN = {"contact": CONTACT, "velocity": 1.0}


def _path():
    zeros = jnp.zeros(3)
    energy = None
    return jc.Trajectory(zeros, zeros, zeros, zeros, energy, jnp.asarray(0))


def _heard():
    envelope = Envelope(0.1, np.ones(9), np.ones(9))
    sound = Sound("WAV", 0.9, 1, (), (), envelope)
    return dataclasses.replace(jc.read_recording(interval_s=[0.4]), sound=sound)


def _table():
    return jc.sweep(lambda e: 2 * e, e=np.linspace(0, 1, 3))


def _axes(*shape):
    return plt.figure().subplots(*shape)


@functools.cache
def cases():
    fitted, exported = a_fit(), jc.export(LAW, CONTACT, 1.0, engine="exudyn")
    of_steps = dataclasses.replace(exported, law=UNSOLVED, scheme=Scheme.SEMI_IMPLICIT)
    return [
        # To other simulators
        case(
            "mjx.time_step",
            f"{SPEEDS} but with nan or range: velocity; INSIDE: error; WHOLE: substeps",
        ),
        case("export", f"contact: contact; {SPEEDS}: velocity", engine="drake", **GIVEN),
        *(
            case(f"export, {engine}", groups, **{"law": LAW, "engine": engine} | GIVEN | good)
            for engine, groups, good in (
                ("lammps", "POSITIVE: radius; None: damping", {"radius": 1.0}),
                ("simbody", "POSITIVE: radius", {}),
                ("yade", "INSIDE or None or zero: poisson_ratio", {"radius": 1.0}),
                ("drake", "None: discrete_contact_approximation", {}),
                ("exudyn", "None or zero: impact_model", {}),
                ("adams", "POSITIVE or None: d; None: length", {}),
            )
        ),
        method(exported, "holds"),
        method(of_steps, "at_time_step", "POSITIVE: time_step", time_step=1e-3),
        # Pictures
        case("plot.trajectory", "NOTHING: path", path=_path(), ax=_axes()),
        case("plot.law", "POSITIVE or None: velocity", contact=CONTACT, velocity=1.0),
        case("plot.impact", "NOTHING: path", path=_path(), ax=_axes(1, 3)),
        case("plot.save", ax=_axes(), file="picture.png"),
        case("report", "POSITIVE or None: radius", calibration=blank(jc.Calibration), file="a.md"),
        case("plot.fit", "THREE or ONE or None or with nan: x", result=fitted, ax=_axes()),
        case("plot.residuals", result=fitted),
        case("plot.profile", result=fitted, names=["a", "b"]),
        case("plot.corner", result=fitted, ax=_axes(2, 2)),
        case(
            "sweep",
            "function: fn; None: samples; NAME or None: store",
            untested="CALLABLE",
            **{"fn": _doubled, "e": np.linspace(0, 1, 3), "progress": False},
        ),
        case(
            "sweep, axis",
            f"{_SWEPT}: e",
            untested=" or ".join(KINDS.keys() - kinds_of(_SWEPT) - kinds_of(_NO_NUMBERS)),
            **{"fn": _doubled, "e": 0.5, "progress": False},
        ),
        method(_table(), "select", "INSIDE or zero: e; None: method", e=0.5),
        method(_table(), "to_csv"),
        case("plot.sweep", table=_table(), ax=_axes()),
        case("plot.calibration", result=blank(jc.Calibration)),
        case("plot.choice", result=blank(jc.LawChoice)),
        case("plot.sound", recording=_heard()),
        case("plot.track", recording=jc.read_recording(time=np.arange(40) / 60, y=TRACK)),
        case("plot.record", recording=jc.read_recording(force=RECORD, rate=1e3)),
        case("paper.markdown", "empty list: table"),
    ]

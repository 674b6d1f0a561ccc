"""Every public callable, good arguments for it, and which kinds of values are legal for each.

A call that gets as far as the physics raises `Reached` there instead of compiling it, which shows
that its arguments were accepted.
"""

import dataclasses
import functools
import types
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxcontact as jc
from jaxcontact._fit import Bootstrap
from jaxcontact._fit._profile import Profile
from jaxcontact._laws._registry import _REGISTRY
from tests.test_every_argument.kinds import (
    ARRAYS,
    CALLABLE,
    CONTACT,
    FLAG,
    INSIDE,
    JAX_SCALARS,
    KINDS,
    LAW,
    NONE,
    POSITIVE,
    POSITIVES,
    REAL,
    REALS,
    STEEL,
    TEXT,
    WHOLE,
    E,
)


class Reached(Exception):
    """The arguments were accepted."""


def reached(*given, **named):
    raise Reached


class Unsolved(jc.AbstractLaw):
    """A law that is never solved."""

    def force(self, indentation, velocity, contact, impact_velocity):
        raise Reached

    def form(self, contact, scale):
        raise Reached


class Blank:
    """A result whose numbers are not there."""

    def __init__(self):
        pass

    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        raise Reached


def blank(kind):
    return type(kind.__name__, (Blank, kind), {})()


@dataclasses.dataclass(frozen=True)
class Case:
    """A public callable with good arguments, and the legal kinds of each argument.

    What is `staged` is traced and not compiled, which would take most of the time. `untested` are
    kinds that are legal and fail by themselves.
    """

    function: Callable[..., Any]
    good: Mapping[str, Any]
    legal: Mapping[str, frozenset[str]]
    staged: bool = False
    untested: frozenset[str] = frozenset()

    def call(self, name, value):
        given = {**self.good, name: value}
        if self.staged:
            return jax.eval_shape(lambda: self.function(**given))
        return self.function(**given)


LAWS, CONTACTS, MATERIALS = frozenset({"law"}), frozenset({"contact"}), frozenset({"material"})
NOTHING: frozenset[str] = frozenset()
METHODS = NOTHING
SWITCH = FLAG
EMPTY = frozenset({"empty list"})
PROGRESS = FLAG | CALLABLE
UNSOLVED = Unsolved()
V = np.linspace(0.5, 3.0, 7)
OUT = 0.9 - 0.05 * V
COLUMN = NOTHING  # no kind has six numbers
MEASURED = jc.read_recording(velocity=V, restitution=OUT)
NUMBERS_3 = frozenset({"tuple", "range", "Series"})
LIST_OF_NUMBERS = frozenset({"tuple", "list of text", "shape (1,)", "jax shape (1,)", "Series"})
"""Text may be a number there, as it is in a file."""


def _line(params, x):
    return params["a"] + params["b"] * x


@functools.cache
def a_fit():
    x = np.linspace(0, 1, 8)
    return jc.fit(_line, 1 + 2 * x + 0.1 * np.cos(40 * x), {"a": 0.5, "b": 1.0}, x=x)


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


def _path():
    zeros = jnp.zeros(3)
    energy = None
    return jc.Trajectory(zeros, zeros, zeros, zeros, energy, jnp.asarray(0))


def _choice():
    empty = {f.name: None for f in dataclasses.fields(jc.LawChoice)}
    there = {
        "fits": {"constant e": a_fit()},
        "laws": (),
        "kinds": (types.SimpleNamespace(name="constant e", law_of=reached),),
        "best": "constant e",
        "reference": 1.0,
    }
    return jc.LawChoice(**empty | there)


def a_bounce():
    two, one = jnp.ones(2), jnp.ones(())
    names = [field.name for field in dataclasses.fields(jc.Bounce)]
    per_touch = {"time", "duration", "impact_velocity", "restitution", "height", "status"}
    return jc.Bounce(**{name: two if name in per_touch else one for name in names})


def _table():
    return jc.sweep(lambda e: 2 * e, e=np.linspace(0, 1, 3))


def constructed(law):
    """The cases of a law's own parameters."""
    from jaxcontact._parameter import ranges

    good = {name: allowed.inside for name, allowed in ranges(law).items()}
    legal = {
        name: {
            "[0, 1]": E | {"zero"},
            "(0, 1]": E,
            "[0, inf)": POSITIVES | {"zero"},
            "(0, inf)": POSITIVES,
            "(-inf, inf)": REALS,
        }[str(allowed)]
        for name, allowed in ranges(law).items()
    }
    return Case(law, good, legal | {"tension": FLAG})


IMPACT = {"law": UNSOLVED, "contact": CONTACT, "velocity": 1.0}
SPEED = POSITIVES
IMPACT_LEGAL = {"law": LAWS, "contact": CONTACTS, "velocity": SPEED}
FIT = {"data": V, "start": {"a": 1.0, "b": 0.5}, "x": V, "predict": _line}
HOW = {"velocity": V, "e": OUT, "contact": CONTACT}
FORCE = {"indentation": 1e-3, "velocity": 0.1, "contact": CONTACT, "impact_velocity": 1.0}
FORCE_LEGAL = {
    "indentation": REALS,
    "velocity": REALS,
    "contact": CONTACTS,
    "impact_velocity": REALS,
}
COUNT = WHOLE
SEED = WHOLE | {"zero"}
RECORDED = {"velocity": V, "restitution": OUT}


@functools.cache
def cases() -> dict[str, Case]:
    laws = {name: getattr(jc, name) for name in dir(jc)}
    laws = {
        name: kind
        for name, kind in laws.items()
        if isinstance(kind, type)
        and issubclass(kind, jc.AbstractLaw)
        and not name.startswith("Abstract")
    }
    optional = {name: constructed(kind) for name, kind in laws.items()}
    fitted = a_fit()
    return optional | {
        # Contacts
        "Material": Case(
            jc.Material,
            {"youngs_modulus": 1.0, "poisson_ratio": 0.3},
            {
                "youngs_modulus": POSITIVES,
                "poisson_ratio": INSIDE | ARRAYS | JAX_SCALARS | {"zero"},
                "density": POSITIVES | NONE,
            },
        ),
        "Material.sphere_mass": Case(STEEL.sphere_mass, {}, {"radius": POSITIVES}, staged=True),
        "Contact": Case(
            jc.Contact,
            {"mass": 1.0, "stiffness": 1.0},
            {
                "mass": POSITIVES,
                "stiffness": POSITIVES,
                "exponent": ARRAYS | JAX_SCALARS | {"one and a half"},
            },
        ),
        "Contact.sphere_sphere": Case(
            jc.Contact.sphere_sphere,
            {"radius": 0.1, "other_radius": 0.1, "sphere": STEEL, "other": STEEL},
            {
                "radius": POSITIVES,
                "other_radius": POSITIVES,
                "sphere": MATERIALS,
                "other": MATERIALS,
                "mass": POSITIVES | NONE,
            },
            staged=True,
        ),
        "Contact.sphere_plane": Case(
            jc.Contact.sphere_plane,
            {"radius": 0.1, "sphere": STEEL},
            {
                "radius": POSITIVES,
                "sphere": MATERIALS,
                "plane": MATERIALS | NONE,
                "mass": POSITIVES | NONE,
            },
            staged=True,
        ),
        "Contact.sphere_socket": Case(
            jc.Contact.sphere_socket,
            {"radius": 0.1, "socket_radius": 5.0, "sphere": STEEL},
            {
                "radius": POSITIVES,
                "socket_radius": POSITIVES,
                "sphere": MATERIALS,
                "socket": MATERIALS | NONE,
                "mass": POSITIVES | NONE,
            },
            staged=True,
        ),
        # Laws
        **{
            f"{name}.force": Case(law.force, FORCE, FORCE_LEGAL, staged=True)
            for name, law in {
                "HuGuo": LAW,
                "Tsuji": jc.Tsuji(e=0.5),
                "KuwabaraKono": jc.KuwabaraKono(A=1e-3),
                "ConstantDamping": jc.ConstantDamping(c=1.0),
            }.items()
        },
        **{
            f"{name}.damping_factor": Case(
                law.damping_factor, {"contact": CONTACT, "velocity": 1.0}, legal
            )
            for name, law, legal in [
                (
                    "ConstantDamping",
                    jc.ConstantDamping(c=1.0),
                    {"contact": CONTACTS, "velocity": REALS},
                ),
                (
                    "PowerDamping",
                    jc.PowerDamping(c=1.0, power=1.0, reference=1.0),
                    {"contact": CONTACTS, "velocity": REALS},
                ),
                ("MarhefkaOrin", jc.MarhefkaOrin(a=1.0), {"velocity": REALS}),
                ("EnergyLoss", jc.EnergyLoss(e=0.5, beta=2.5), {"contact": CONTACTS | NONE}),
            ]
        },
        "get_law": Case(jc.get_law, {"name": "hertz"}, {"name": NOTHING}),
        "register_law": Case(
            _register,
            {"name": "abc"},
            {
                "name": TEXT - {"empty text"},
                "formula": TEXT,
                "source": TEXT,
                "valid": TEXT,
                "cls": frozenset({"law class"}),
            },
        ),
        "exact_damping_factor": Case(jc.exact_damping_factor, {}, {"e": E}, staged=True),
        "power": Case(
            jc.power, {"x": 0.5, "exponent": 1.5}, {"x": REALS, "exponent": REALS}, staged=True
        ),
        # One impact
        "impact": Case(
            jc.impact,
            IMPACT,
            IMPACT_LEGAL | {"method": METHODS, "external_force": REALS | NONE},
        ),
        "restitution": Case(
            jc.restitution,
            IMPACT,
            {
                "law": LAWS,
                "contact": CONTACTS | NONE,
                "velocity": SPEED | NONE,
                "method": METHODS,
            },
        ),
        "trajectory": Case(
            jc.trajectory,
            IMPACT,
            IMPACT_LEGAL | {"samples": COUNT, "method": METHODS, "external_force": REALS | NONE},
        ),
        "bounce": Case(
            jc.bounce,
            {"law": UNSOLVED, "contact": CONTACT, "height": 1.0},
            {
                "law": LAWS,
                "contact": CONTACTS,
                "height": POSITIVES,
                "gravity": POSITIVES,
                "bounces": COUNT,
                "gravity_in_contact": SWITCH,
                "rest_velocity": POSITIVES | NONE,
                "method": METHODS,
            },
        ),
        "Bounce.height_at": Case(a_bounce().height_at, {}, {"time": REALS}, staged=True),
        "Event": Case(
            jc.Event,
            {},
            {
                "rtol": INSIDE | NONE,
                "atol": INSIDE | NONE,
                "solver": NONE,
                "adjoint": NONE,
                "max_steps": COUNT,
            },
        ),
        "Phase": Case(jc.Phase, {}, {"steps": COUNT, "tolerance": INSIDE | NONE}),
        # Fits
        "fit": Case(
            jc.fit,
            FIT,
            {
                "predict": CALLABLE,
                # Any tree of numbers, which the prediction must match.
                "data": REALS - {"empty list", "shape (0,)", "with nan"}
                | {"dict of numbers", "ragged", "law", "contact", "material"},
                # Whole arrays of JAX stay as they are, and there is nothing to fit.
                "start": REAL - {"jax whole"}
                | ARRAYS - {"empty list", "range", "shape (0,)", "with nan"}
                | {"dict of numbers", "ragged", "law", "contact", "material"},
                # Any tree of arrays, which the prediction must know what to do with.
                "x": REALS
                | NONE
                | FLAG
                | {"dict", "dict of numbers", "ragged", "list of None"}
                | {"complex", "numpy complex", "array of complex", "jax complex", "jax flags"}
                | {"nan", "inf", "-inf", "array of flags", "jax key", "law", "contact", "material"},
                "sigma": POSITIVE | NONE,
                "weights": POSITIVE | NONE,
                "groups": NONE,
                "transforms": NONE | {"dict"},
                "loss": NOTHING,
                "optimizer": NOTHING,
                "starts": COUNT,
                "spread": POSITIVE,
                "seed": SEED,
                "max_steps": COUNT | NONE,
                "patience": COUNT,
                "rtol": POSITIVE,
                "reverse": SWITCH,
                "progress": PROGRESS | NONE,
            },
        ),
        "Huber": Case(jc.Huber, {}, {"threshold": POSITIVE}),
        "Between": Case(
            jc.Between,
            {"low": -5.0, "high": 10.0},
            {"low": REAL, "high": REAL},
        ),
        "Fit.predict": Case(fitted.predict, {}, {"x": REALS | NONE}),
        "Fit.predict_with_error": Case(fitted.predict_with_error, {}, {"x": REALS | NONE}),
        "Fit.bootstrap": Case(fitted.bootstrap, {}, {"draws": COUNT, "seed": SEED}),
        "Fit.profile": Case(
            fitted.profile,
            {"name": "a"},
            {
                "name": NOTHING,
                "values": REALS - {"with nan", "empty list", "shape (0,)"} | NONE,
                "points": COUNT,
                "span": POSITIVE,
            },
        ),
        "Bootstrap.interval": Case(
            Bootstrap(("a",), np.ones((3, 1)), np.ones(3, bool)).interval, {}, {"level": INSIDE}
        ),
        "Profile.interval": Case(
            Profile("a", 1.0, V, V, V - 1.75, 4, False).interval, {}, {"level": INSIDE}
        ),
        "compare_fits": Case(
            jc.compare_fits,
            {"fits": {"one": fitted, "two": fitted}},
            {
                "fits": NOTHING,
                "folds": COUNT,
                "groups": NONE,
                "seed": SEED,
            },
        ),
        # Laws from measurements
        "fit_damping": Case(
            jc.fit_damping,
            HOW,
            {
                "velocity": COLUMN,
                "e": COLUMN,
                "contact": CONTACTS,
                "form": NOTHING,
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
                "form": NOTHING,
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
            {"time": V, "law": LAW, "contact": CONTACT, "velocity": 1.0, "force": OUT},
            {
                "time": COLUMN,
                "law": LAWS,
                "contact": CONTACTS,
                "velocity": POSITIVE,
                "force": NOTHING,
                "indentation": NONE,
                "sigma_force": POSITIVE | NONE,
                "start_time": REAL | NONE,
                "fixed": EMPTY,
            },
        ),
        "fit_record, indentation": Case(
            jc.fit_record,
            {"time": V, "law": LAW, "contact": CONTACT, "velocity": 1.0, "indentation": OUT},
            {"sigma_indentation": POSITIVE | NONE},
        ),
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
                "velocity": COLUMN,
                "e": COLUMN,
                "contact": CONTACTS,
                "law": NOTHING,
                "sigma": POSITIVE | NONE,
                "weights": POSITIVE | NONE,
                "groups": NONE,
                "mark_outliers": SWITCH,
            },
        ),
        "LawChoice.law": Case(_choice().law, {}, {"kind": NONE}),
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
                "law": NOTHING,
                "drag": NONE,
                "mass": POSITIVE | NONE,
                "stiffness": POSITIVE | NONE,
                "gravity": POSITIVE,
                "progress": FLAG | {"function"},
            },
            # Classes are functions, which are called with a text here.
            untested=frozenset({"class", "law class"}),
        ),
        "Calibration.save": Case(
            jc.Calibration(*[None] * 5, summary=blank(jc.CalibrationSummary)).save,
            {},
            {"path": TEXT - {"empty text"}},
        ),
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
            },
        ),
        "read_recording, columns": Case(
            jc.read_recording,
            RECORDED,
            {
                "velocity": NOTHING,
                "restitution": NOTHING,
            },
        ),
        "read_recording, column of intervals": Case(
            jc.read_recording,
            {"interval_s": V},
            {"interval_s": LIST_OF_NUMBERS, "ball": NONE | {"empty text"}},
        ),
        # To other simulators
        "export": Case(
            jc.export,
            {"law": UNSOLVED, "contact": CONTACT, "velocity": 1.0, "engine": "drake"},
            IMPACT_LEGAL | {"velocity": POSITIVE, "engine": NOTHING},
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
        "export, exudyn": Case(
            jc.export,
            {"law": LAW, "contact": CONTACT, "velocity": 1.0, "engine": "exudyn"},
            {"impact_model": NONE},
        ),
        # Pictures
        "plot.trajectory": Case(
            jc.plot.trajectory,
            {"path": _path(), "ax": plt.figure().add_subplot()},
            {"path": NOTHING, "x": NOTHING, "y": NOTHING, "ax": NONE, "label": TEXT | NONE},
        ),
        "plot.fit": Case(
            jc.plot.fit,
            {"result": fitted, "ax": plt.figure().add_subplot()},
            {
                "result": NOTHING,
                "x": NUMBERS_3 | NONE | {"shape (1,)", "jax shape (1,)", "with nan"},
                "ax": NONE,
            },
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
            jc.plot.calibration,
            {"result": blank(jc.Calibration)},
            {"result": NOTHING, "ax": NONE},
        ),
        "plot.choice": Case(
            jc.plot.choice, {"result": blank(jc.LawChoice)}, {"result": NOTHING, "ax": NONE}
        ),
        "paper.markdown": Case(jc.paper.markdown, {}, {"table": EMPTY}),
    }


def _register(name, cls=Unsolved, **words):
    made = jc.register_law(name, **words)(cls)
    del _REGISTRY[name]
    return made


EXEMPT = {
    # Results, which the library makes
    r"(Bounce|Calibration|CalibrationSummary|Export|Fit|Impact|LawChoice|Recording|ScaledImpact|"
    r"Sweep|Trajectory|VelocityProfile)\(.*\)": "a result, made by the library",
    r"RecordingError\(.*\)": "an error, raised by the library",
    r"paper\.(Number|Published|Reproduction)\(.*\)": "a result, made by the library",
    r"Status\(.*\)": "an enumeration of Python",
    # Called by the library, with arguments that are checked before
    r"Abstract(Law|HuntCrossley|Form|Method|Shape)(\..*)?\(.*\)": "an interface to fill in",
    r"Sweep\.(coordinates|taken)\(.*\)": "called by the library",
    r".*\.(form|chosen|solve|over|tolerances|damping_ratio)\(.*\)": "called by the library",
    r"(Exact|Event|Phase)\.restitution\(.*\)": "called by the library",
    r".*\.damping_factor\(.*\)": "not used where α does not depend on it",
}
"""Patterns of callables and arguments that are not in the table, and why."""

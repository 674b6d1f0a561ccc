"""A public callable with valid arguments, and the groups of legal values for each of them.

A call that reaches the physics raises `Reached` there instead of compiling it. This shows that its
arguments were accepted.
"""

import dataclasses
import functools
import inspect
import operator
import re
from collections.abc import Callable, Mapping
from typing import Any

import jax
import numpy as np
from matplotlib import pyplot
from matplotlib.animation import FuncAnimation

import jaxcontact as jc
from tests.test_every_argument.kinds import CONTACT, STEEL, kinds_of


class Reached(Exception):
    """The arguments were accepted."""


def reached(*given, **named):
    raise Reached


class Unsolved(jc.AbstractLaw):
    """A law that is never solved."""

    tension = False

    def force(self, indentation, velocity, contact, impact_velocity):
        raise Reached

    def form(self, contact, scale):
        raise Reached


class Blank:
    """A result whose numbers are not there."""

    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        raise Reached


def blank(kind):
    return object.__new__(type(kind.__name__, (Blank, kind), {}))


UNSOLVED = Unsolved()
V = np.linspace(0.5, 3.0, 7)
OUT = 0.9 - 0.05 * V
TRACK = [abs(k / 20 - 1) * (2 - abs(k / 20 - 1)) for k in range(40)]  # before and after an impact
RECORD = [*[0.0] * 30, *(k * (30 - k) for k in range(30)), *[0.0] * 30]
USUAL = {"law": UNSOLVED, "contact": CONTACT, "velocity": 1.0, "tangential_velocity": 1.0}
USUAL |= {"indentation": 1e-3, "impact_velocity": 1.0, "friction": jc.RigidCoulomb(mu=0.1)}
USUAL |= {"socket_radius": 5.0, "poisson_ratio": 0.3, "x": 0.5, "exponent": 1.5}
USUAL |= dict.fromkeys("mass stiffness height duration frequency youngs_modulus".split(), 1.0)
USUAL |= dict.fromkeys("radius other_radius mu e amplitude viscosity work_of_adhesion".split(), 0.1)
USUAL["critical_stokes"] = 1.0
USUAL |= dict.fromkeys(("sphere", "other", "material"), STEEL) | {"name": "abc", "e_in": OUT}


@dataclasses.dataclass(frozen=True)
class Case:
    """A public callable with good arguments, and the legal kinds of each argument.

    What is `staged` is traced and not compiled, where that would take most of the time. `untested`
    are kinds that are legal and fail by themselves.
    """

    label: str
    function: Callable[..., Any]
    good: Mapping[str, Any]
    legal: Mapping[str, frozenset[str]]
    staged: bool
    untested: frozenset[str]

    def call(self, name, value):
        given = {**self.good, name: value}
        if self.staged:
            return jax.eval_shape(lambda: self.function(**given))
        return self.function(**given)


EXEMPT = {
    "a result, made by the library": (
        r"(Bounce|Calibration|CalibrationSummary|Design|EngineRun|Export|FastLoops|Fits?"
        r"|FrictionCalibration|FrictionChoice|Impacts?|LawChoice|Margin|Oblique(Impact|Trajectory)"
        r"|Posterior|Recording|Run|ScaledImpact|SceneExport|States|Sweep|Trajectory|VelocityProfile"
        r"|System(Contacts|Margin|Phases|Run|States)|paper\.(Number|Published|Reproduction))\(.*\)"
    ),
    "an error, raised by the library": r"RecordingError\(.*\)",
    "an enumeration of Python": r"(Status|FitStatus|Ending|Slip|SolvedBy)(\.names_of)?\(.*\)",
    "an interface to fill in": (
        r"Abstract(Law|HuntCrossley|ElasticPlastic|Form|Friction|Method|Shape)(\..*)?\(.*\)"
    ),
    "what the library and a friction law exchange": r"Tangential(Outcome)?(\..*)?\(.*\)",
    "called by the library, with arguments that are checked before": (
        r"Sweep\.(coordinates|taken)\(.*\) Sphere\.moved_to\(.*\) Shell\.centre_at\(.*\) "
        r"(Sphere|Plane|Box|Shell)\.after\(.*\) (Steady|Vibration|Prescribed)\.(start|after)\(.*\) "
        r"LowPass\.(read|correlation)\(.*\) RoundBodies\.(arms|mobility|require_mass)\(.*\) "
        r".*\.(form|chosen|solve|error|over|tolerances|damping_ratio|jumps)\(.*\) "
        r".*\.(rebound|along|has_formula|uncovered)\(.*\) (Exact|Event|Phase)\.restitution\(.*\) "
        r"RegularizedCoulomb\.force\(.*\)"
    ),
    "see `fit`": (
        r"(choose_[a-z]+|learn_law|fit_[a-z_]+)\((weights|groups|correlation|transforms|sigma|loss"
        r"|noise|optimizer|starts|spread|seed|max_steps|patience|rtol|reverse|progress|throw)\)"
    ),
    "see test_scenes.py and test_read_run.py of tests/engines/test_export": (
        r"export_scene\(time_step\) SceneExport\..* EngineRun\..* read_run\(.*\)"
    ),
    "see test_oblique.py, test_many.py and test_general.py": (
        r"FrictionChoice\.friction\(name\) Fits\.fit\(ball\) Fit\.why_no_error\(name\)"
    ),
    "needs MJX or JaxSim, which the tests of engines have": (
        r"systems\.from_mjx\(.*\) "
        r"(mjx|jaxsim)\.(contact_force|(Contact|Terrain)Force(\.(init|step))?)\(.*\)"
    ),
    "a setting of the process, in tests/lab/test_cli/test_cache.py": r"cache\(folder\)",
    "whatever the functions take": r"(Prescribed|simulate)\(args\)",
    "needs an exponent that the contacts of the table lack": r"Luding\.force\(contact\)",
    "not used where α does not depend on it": r".*\.damping_factor\(.*\)",
}
"""Why callables and arguments are not in the table, and their patterns."""


def is_exempt(argument):
    """Whether an argument, as in "fit(data)", is left out of the table."""
    patterns = " ".join(EXEMPT.values()).split()
    return any(re.fullmatch(pattern, argument) for pattern in patterns)


def legal_of(groups):
    """The legal kinds by argument, from "POSITIVE or None: mass; FLAG: throw"."""
    pairs = [group.split(": ") for group in groups.split("; ") if group]
    legal = [(name, kinds_of(words)) for words, some in pairs for name in some.split()]
    assert len(dict(legal)) == len(legal), groups
    return dict(legal)


LEGAL = legal_of(
    "law: law; contact: contact; material: material other plane socket sphere; NAME: path; "
    "FLAG: reverse throw; SEED: seed; INSIDE: level; TEXT: label name; PROGRESS: progress; "
    "WHOLE: batch_size draws max_cluster max_impacts max_steps samples; EXPONENT: exponent; "
    "empty list: fixed; CALLABLE: gap predict slip; "
    "POSITIVES: mass other_radius radius socket_radius stiffness; "
    "POSITIVE: clearance duration sigma weights within; POSITIVES or zero: mu; "
    "REALS: external_force impact_velocity indentation largest tangential_velocity velocity"
)
"""What an argument of a name takes anywhere, besides None where that is its default."""


def case(label, groups="", function=None, /, staged=False, untested="", apart="", **good):
    """A case of a public name, to which a comma may add what tells it from others.

    `groups` has legal kinds with the names of arguments, "POSITIVE or None: mass; FLAG: throw". All
    other arguments take what is usual, or nothing; a case with a comma leaves them alone, any case
    those that are `apart`, in another one. A required argument not given is the usual one.
    """
    function = function or operator.attrgetter(label.split(",")[0])(jc)
    legal = legal_of(groups)
    for name, one in inspect.signature(function).parameters.items():
        if one.kind in (one.VAR_POSITIONAL, one.VAR_KEYWORD):
            continue
        if one.default is one.empty and name in USUAL:
            good.setdefault(name, USUAL[name])
        if not ("," in label or name in apart.split() or is_exempt(f"{label}({name})")):
            none = kinds_of("None" if one.default is None else "")
            legal.setdefault(name, LEGAL.get(name, none) | none)
    return Case(label, function, good, legal, staged, kinds_of(untested))


def drawn(name, run, groups="", /, **good):
    """A picture of a run that is made when it is needed, not while tests are collected."""
    draw = getattr(jc.plot, name)

    @functools.wraps(draw)
    def now(**given):
        made = draw(**({"run": run()} | given))
        # Matplotlib warns of an animation without any frame, once it is gone.
        if isinstance(made, FuncAnimation):
            made.figure.canvas.draw()
        return made

    return case(f"plot.{name}", groups, now, ax=pyplot.figure().add_subplot(), **good)


def method(owner, name, groups="", /, **options):
    return case(f"{type(owner).__name__}.{name}", groups, getattr(owner, name), **options)

"""A public callable with valid arguments, and the groups of legal values for each of them.

A call that reaches the physics raises `Reached` there instead of compiling it. This shows that its
arguments were accepted.
"""

import dataclasses
import inspect
import operator
from collections.abc import Callable, Mapping
from typing import Any

import jax
import numpy as np

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

    def __init__(self):
        pass

    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        raise Reached


def blank(kind):
    return type(kind.__name__, (Blank, kind), {})()


UNSOLVED = Unsolved()
V = np.linspace(0.5, 3.0, 7)
OUT = 0.9 - 0.05 * V
TRACK = [abs(k / 20 - 1) * (2 - abs(k / 20 - 1)) for k in range(40)]  # before and after an impact
RECORD = [*[0.0] * 30, *(k * (30 - k) for k in range(30)), *[0.0] * 30]
USUAL = {"law": UNSOLVED, "contact": CONTACT, "velocity": 1.0, "tangential_velocity": 1.0}
USUAL |= {"indentation": 1e-3, "impact_velocity": 1.0, "friction": jc.RigidCoulomb(mu=0.1)}
USUAL |= dict.fromkeys(("mass", "stiffness", "height", "duration"), 1.0)
USUAL |= dict.fromkeys(("radius", "other_radius", "mu", "e"), 0.1) | {"x": 0.5, "exponent": 1.5}
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


def case(label, groups, function=None, /, staged=False, untested="", **good):
    """A case of a public name, to which a comma may add what tells it from others.

    `groups` has legal kinds with the names of arguments, "POSITIVE or None: mass; FLAG: throw". A
    required argument that is not given is the usual one.
    """
    function = function or operator.attrgetter(label.split(",")[0])(jc)
    pairs = [group.split(": ") for group in groups.split("; ") if group]
    names = [name for _, some in pairs for name in some.split()]
    assert len(set(names)) == len(names), label
    legal = {name: kinds_of(words) for words, some in pairs for name in some.split()}
    for name, one in inspect.signature(function).parameters.items():
        needed = one.default is one.empty and one.kind not in (one.VAR_POSITIONAL, one.VAR_KEYWORD)
        if needed and name in USUAL:
            good.setdefault(name, USUAL[name])
    return Case(label, function, good, legal, staged, kinds_of(untested))


def method(owner, name, groups, /, **options):
    return case(f"{type(owner).__name__}.{name}", groups, getattr(owner, name), **options)

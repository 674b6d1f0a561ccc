"""A public callable with valid arguments, and the groups of legal values for each of them.

A call that reaches the physics raises `Reached` there instead of compiling it. This shows that its
arguments were accepted.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import jax
import numpy as np

import jaxcontact as jc
from tests.test_every_argument.kinds import CALLABLE, FLAG, WHOLE


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


@dataclasses.dataclass(frozen=True)
class Case:
    """A public callable with good arguments, and the legal kinds of each argument.

    What is `staged` is traced and not compiled, where that would take most of the time. `untested`
    are kinds that are legal and fail by themselves.
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
NUMBERS_3 = frozenset({"tuple", "range", "Series"})
TRACK = [abs(k / 20 - 1) * (2 - abs(k / 20 - 1)) for k in range(40)]  # before and after an impact
COUNT = WHOLE
SEED = WHOLE | {"zero"}

"""The interface of methods: options, whether a method applies, and its solve."""

from __future__ import annotations

import abc
import functools
import math
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from ..._forms import AbstractForm, Lane, ScaledImpact
from ..._parameter import FRACTION, require_count, require_number
from ..front_door import Lanes


class AbstractMethod(eqx.Module):
    """A way to solve an impact, with its options as fields.

    A subclass sets `name` (which `Impact.method` repeats), gives `chosen` and `solve`, and works as
    the `method` of `impact`, `restitution` and `bounce`. Options that are Python values are
    declared with `eqx.field(static=True)`: methods with equal options share compiled code.
    """

    name: eqx.AbstractClassVar[str]
    has_formula: ClassVar[bool] = False
    """Whether the method may be a formula, which compiles in less time than the solve of a form."""

    @abc.abstractmethod
    def chosen(self, form: AbstractForm, pushed: bool) -> AbstractMethod:
        """The method that solves this form, `pushed` by an external force or not: mostly `self`.

        Raises ValueError where the method does not apply; the message names one that does.
        """

    @abc.abstractmethod
    def solve(self, lanes: Lanes) -> ScaledImpact:
        """The scaled outcome, in a shape that broadcasts to that of the problem.

        `lanes.form`, `lanes.n` and `lanes.push` (None without external force) are the scaled
        problem; lanes with invalid input hold valid numbers in its place.
        """

    def error(self, dtype: Any) -> float:
        """The error of restitutions that is taken for rounding."""
        return math.sqrt(jnp.finfo(dtype).eps)

    def restitution(self, form: AbstractForm) -> Lane | None:
        """The e of a free impact where no solve is necessary for it; None where one is."""
        return None


def tolerance_field(name: str) -> Any:
    """A field for a tolerance: a Python float, from any concrete real scalar; None stays None."""

    def convert(value: Any) -> float | None:
        return None if value is None else require_number(name, value, FRACTION)

    return eqx.field(static=True, default=None, converter=convert)


def count_field(name: str, default: int) -> Any:
    """A field for a number of steps: a Python int, from any concrete whole scalar."""
    convert = functools.partial(require_count, name, least=2)
    return eqx.field(static=True, default=default, converter=convert)

"""The interface of methods: options, applicability, and solve."""

from __future__ import annotations

import abc
import functools
import math
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from ..._entry import FRACTION, require_count, require_number
from ..._forms import AbstractForm, Lane, ScaledImpact
from ..front_door import Lanes


class AbstractMethod(eqx.Module):
    """A way to solve an impact, with its options as fields.

    A subclass sets `name`, which `Impact.method` repeats, and implements `chosen` and `solve`. It
    then works as the `method` of `impact`, `restitution` and `bounce`. Declare options that are
    Python values with `eqx.field(static=True)`: methods with equal options share compiled code.
    """

    name: eqx.AbstractClassVar[str]
    has_formula: ClassVar[bool] = False
    """True if the method may use a formula, which compiles faster than the solve of a form."""

    @property
    def solved_by(self) -> str | None:
        """What takes the steps, as `Impact` prints it beside the method; None if it has no name."""
        return None

    @abc.abstractmethod
    def chosen(self, form: AbstractForm, pushed: bool) -> AbstractMethod:
        """Return the method that solves this form, usually `self`. `pushed`: whether an external
        force acts. Raises ValueError if the method does not apply; the message names one that does.
        """

    @abc.abstractmethod
    def solve(self, lanes: Lanes) -> ScaledImpact:
        """Return the scaled outcome, in a shape that broadcasts to that of the problem.
        `lanes.form`, `lanes.n` and `lanes.push` (None without an external force) are the scaled
        problem. Lanes with invalid input hold valid substitutes.
        """

    def error(self, dtype: Any) -> float:
        """Return the excess of e over 1 that counts as numerical error."""
        return math.sqrt(jnp.finfo(dtype).eps)

    def restitution(self, form: AbstractForm) -> Lane | None:
        """Return the e of a free impact if it needs no solve, else None."""
        return None


def tolerance_field(name: str) -> Any:
    """Return a field for a tolerance: a Python float from any concrete real scalar, or None."""

    def convert(value: Any) -> float | None:
        return None if value is None else require_number(name, value, FRACTION)

    return eqx.field(static=True, default=None, converter=convert)


def count_field(name: str, default: int) -> Any:
    """Return a field for a number of steps: a Python int from any concrete whole scalar."""
    convert = functools.partial(require_count, name, least=2)
    return eqx.field(static=True, default=default, converter=convert)

"""Results that may have failed: their status in words, and the error of a single one."""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import Any, ClassVar, Self, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from .._entry import traced

Result = TypeVar("Result", bound="Flagged")


class NumericalError(RuntimeError):
    """A single call failed numerically. With `throw=False` it returns the flagged result."""


class WordedEnum(enum.IntEnum):
    """Values of a status, each with its words."""

    words: str

    def __new__(cls, value: int, words: str) -> Self:
        member = int.__new__(cls, value)
        member._value_, member.words = value, words
        return member

    @classmethod
    def names_of(cls, status: Any) -> str:
        """Return the names of values, with counts if there are several lanes."""
        if traced(status) or not eqx.is_array(status):
            return str(status)
        kinds, counts = np.unique(np.asarray(status), return_counts=True)
        names = [cls(int(kind)).name.lower() for kind in kinds]
        if np.ndim(status) == 0:
            return names[0]
        return ", ".join(f"{count} {name}" for name, count in zip(names, counts, strict=True))


class Flagged:
    """A result with a `status` of each lane, which is its last entry along `_axes` axes."""

    status: Any
    _failures: ClassVar[tuple[WordedEnum, ...]]
    _axes: ClassVar[int] = 0

    @property
    def ok(self) -> Bool[Array, "..."]:
        """Where the numbers are results, lane by lane."""
        last = self.status[..., -1] if self._axes else self.status
        return jnp.isin(last, np.array(self._failures, last.dtype), invert=True)

    def _why(self) -> str | None:
        """Return why a single finished result failed; None for any other."""
        if traced(status := self.status) or status.ndim > type(self)._axes:
            return None
        last = int(np.asarray(status).flat[-1])
        # Most calls succeed, and a search of all leaves takes as long as a small solve.
        if last not in self._failures or traced(self):
            return None
        kind = self._failures[self._failures.index(last)]
        return f"{kind.name}. {kind.words}"


def checked(
    result: Result, throw: bool, call: str, reason: Callable[[], str | None] = lambda: None
) -> Result:
    """Return a result; if `throw`, raise NumericalError with the `reason` of a single failure."""
    # Equinox would take as long to bind a method as to solve an impact.
    if throw and (why := type(result)._why(result)):
        why = reason() or why
        raise NumericalError(f"`{call}` failed: {why} `throw=False` returns it flagged.")
    return result

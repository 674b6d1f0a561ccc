"""The range of a fitted parameter, and the free coordinate in which it is fitted."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..._entry import Range, require_number


class Coordinate(NamedTuple):
    """Conversion between a bounded value and a free number; it selects code, the bounds are data.

    `label` precedes the name of a parameter in this coordinate. `has_unit`: a change of 1 means the
    same everywhere, as for a logarithm or a logit. The functions take (value, low, high), or (free
    number, low, high). `slope` is dvalue/dfree at a value, and `log_slope` its logarithm at a free
    number.
    """

    label: str
    has_unit: bool
    bounded_above: bool
    to_free: Callable[[float, float, float], float]
    to_value: Callable[[jax.Array, jax.Array, jax.Array], jax.Array]
    slope: Callable[[Any, float, float], Any]
    log_slope: Callable[[jax.Array, jax.Array, jax.Array], jax.Array]


IDENTITY = Coordinate(
    label="",
    has_unit=False,
    bounded_above=False,
    to_free=lambda value, low, high: value,
    to_value=lambda free, low, high: free,
    slope=lambda value, low, high: np.ones_like(value),
    log_slope=lambda free, low, high: jnp.zeros_like(free),
)
LOGARITHM = Coordinate(
    label="ln ",
    has_unit=True,
    bounded_above=False,
    to_free=lambda value, low, high: math.log(value),
    to_value=lambda free, low, high: jnp.exp(free),
    slope=lambda value, low, high: value,
    log_slope=lambda free, low, high: free,
)
LOGIT = Coordinate(
    label="logit ",
    has_unit=True,
    bounded_above=True,
    to_free=lambda value, low, high: math.log((value - low) / (high - value)),
    to_value=lambda free, low, high: low + (high - low) * jax.nn.sigmoid(free),
    slope=lambda value, low, high: (value - low) * (high - value) / (high - low),
    log_slope=lambda free, low, high: (
        jnp.log(high - low) + jax.nn.log_sigmoid(free) + jax.nn.log_sigmoid(-free)
    ),
)


class AbstractTransform:
    """The range of a fitted parameter: `Free`, `Positive`, `Between` or `Fixed`."""

    coordinate: Coordinate = IDENTITY

    @property
    def bounds(self) -> tuple[float, float]:
        """The open interval (low, high) of the values."""
        return -math.inf, math.inf


@dataclasses.dataclass(frozen=True)
class Free(AbstractTransform):
    """Any real number, fitted directly."""


@dataclasses.dataclass(frozen=True)
class Positive(AbstractTransform):
    """A number above 0; its logarithm is fitted."""

    coordinate = LOGARITHM

    @property
    def bounds(self) -> tuple[float, float]:
        return 0.0, math.inf


@dataclasses.dataclass(frozen=True)
class Between(AbstractTransform):
    """A number between `low` and `high`; the logit of its relative position is fitted.

    The ends are approached but never reached; a fit that runs there reports it. Raises ValueError
    unless low < high are finite.
    """

    low: float
    high: float
    coordinate = LOGIT

    def __post_init__(self) -> None:
        for name in ("low", "high"):
            object.__setattr__(self, name, require_number(name, getattr(self, name)))
        if not self.low < self.high:
            raise ValueError(
                f"Argument `high` must be above `low`, but they are {self.high!r} and {self.low!r}."
            )

    @property
    def bounds(self) -> tuple[float, float]:
        return self.low, self.high


@dataclasses.dataclass(frozen=True)
class Fixed(AbstractTransform):
    """A number that is not fitted."""


def of_range(allowed: Range) -> AbstractTransform:
    """Return the transform of a parameter that declares its range."""
    if math.isinf(allowed.low) and math.isinf(allowed.high):
        return Free()
    if allowed.low == 0 and math.isinf(allowed.high):
        return Positive()
    return Between(allowed.low, allowed.high)

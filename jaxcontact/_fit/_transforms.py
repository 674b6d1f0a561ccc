"""How a bounded number becomes a free one: a logarithm or a logit."""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._parameter import Range


class AbstractTransform:
    """Where a fitted number may lie: `Free`, `Positive`, `Between` or `Fixed`."""


@dataclasses.dataclass(frozen=True)
class Free(AbstractTransform):
    """Any real number; fitted as it is."""


@dataclasses.dataclass(frozen=True)
class Positive(AbstractTransform):
    """A number above 0; its logarithm is fitted."""


@dataclasses.dataclass(frozen=True)
class Between(AbstractTransform):
    """A number between `low` and `high`; the logit of its place between them is fitted.

    The ends themselves are approached, never reached: a fit that runs there says so.
    Raises ValueError unless low < high are finite.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        if not -math.inf < self.low < self.high < math.inf:
            raise ValueError(
                f"Argument `high` must be above `low`, both finite, but they are {self.high!r} "
                f"and {self.low!r}."
            )


@dataclasses.dataclass(frozen=True)
class Fixed(AbstractTransform):
    """A number that is not fitted."""


def of_range(allowed: Range) -> AbstractTransform:
    """The transform of a parameter that declares its range."""
    if math.isinf(allowed.low) and math.isinf(allowed.high):
        return Free()
    if allowed.low == 0 and math.isinf(allowed.high):
        return Positive()
    return Between(allowed.low, allowed.high)


def kind_of(transform: AbstractTransform) -> str:
    """What selects code: "free", "log" or "logit"."""
    if isinstance(transform, Between):
        return "logit"
    return "log" if isinstance(transform, Positive) else "free"


def to_free(kind: str, value: float, low: float, high: float) -> float:
    """The free number of a value inside its bounds."""
    if kind == "log":
        return math.log(value)
    if kind == "logit":
        return math.log((value - low) / (high - value))
    return value


def to_value(
    kind: str, free: Float[Array, ""], low: Float[Array, ""], high: Float[Array, ""]
) -> Float[Array, ""]:
    """The value of a free number."""
    if kind == "log":
        return jnp.exp(free)
    if kind == "logit":
        return low + (high - low) * jax.nn.sigmoid(free)
    return free


def slope_of(kind: str, value: float, low: float, high: float) -> float:
    """The derivative of the value by its free number."""
    if kind == "log":
        return value
    if kind == "logit":
        return (value - low) * (high - value) / (high - low)
    return 1.0

"""Where a fitted parameter may lie, and the free coordinate in which it is fitted."""

from __future__ import annotations

import abc
import dataclasses
import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._parameter import Range


class Coordinate(abc.ABC):
    """How a bounded value becomes a free number. Stateless: it selects code, bounds are data."""

    label: str
    """What stands before the name of a parameter in this coordinate."""
    has_unit: bool
    """Whether a change of 1 means the same everywhere, as it does for a logarithm or a logit."""
    bounded_above: bool = False

    @abc.abstractmethod
    def to_free(self, value: float, low: float, high: float) -> float:
        """The free number of a value inside its bounds."""

    @abc.abstractmethod
    def to_value(
        self, free: Float[Array, ""], low: Float[Array, ""], high: Float[Array, ""]
    ) -> Float[Array, ""]:
        """The value of a free number."""

    @abc.abstractmethod
    def slope(self, value: float, low: float, high: float) -> float:
        """The derivative of the value by its free number."""


class _Identity(Coordinate):
    label, has_unit = "", False

    def to_free(self, value: float, low: float, high: float) -> float:
        return value

    def to_value(
        self, free: Float[Array, ""], low: Float[Array, ""], high: Float[Array, ""]
    ) -> Float[Array, ""]:
        return free

    def slope(self, value: float, low: float, high: float) -> float:
        return 1.0


class _Logarithm(Coordinate):
    label, has_unit = "ln ", True

    def to_free(self, value: float, low: float, high: float) -> float:
        return math.log(value)

    def to_value(
        self, free: Float[Array, ""], low: Float[Array, ""], high: Float[Array, ""]
    ) -> Float[Array, ""]:
        return jnp.exp(free)

    def slope(self, value: float, low: float, high: float) -> float:
        return value


class _Logit(Coordinate):
    label, has_unit, bounded_above = "logit ", True, True

    def to_free(self, value: float, low: float, high: float) -> float:
        return math.log((value - low) / (high - value))

    def to_value(
        self, free: Float[Array, ""], low: Float[Array, ""], high: Float[Array, ""]
    ) -> Float[Array, ""]:
        return low + (high - low) * jax.nn.sigmoid(free)

    def slope(self, value: float, low: float, high: float) -> float:
        return (value - low) * (high - value) / (high - low)


_IDENTITY, _LOGARITHM, _LOGIT = _Identity(), _Logarithm(), _Logit()


class AbstractTransform:
    """Where a fitted parameter may lie: `Free`, `Positive`, `Between` or `Fixed`."""

    coordinate: Coordinate = _IDENTITY

    @property
    def bounds(self) -> tuple[float, float]:
        """The open interval of the values."""
        return -math.inf, math.inf


@dataclasses.dataclass(frozen=True)
class Free(AbstractTransform):
    """Any real number; fitted as it is."""


@dataclasses.dataclass(frozen=True)
class Positive(AbstractTransform):
    """A number above 0; its logarithm is fitted."""

    coordinate = _LOGARITHM

    @property
    def bounds(self) -> tuple[float, float]:
        """(0, ∞)."""
        return 0.0, math.inf


@dataclasses.dataclass(frozen=True)
class Between(AbstractTransform):
    """A number between `low` and `high`; the logit of its place between them is fitted.

    The ends are approached, never reached: a fit that runs there says so.
    Raises ValueError unless low < high are finite.
    """

    low: float
    high: float
    coordinate = _LOGIT

    def __post_init__(self) -> None:
        if not -math.inf < self.low < self.high < math.inf:
            raise ValueError(
                f"Argument `high` must be above `low`, both finite, but they are {self.high!r} "
                f"and {self.low!r}."
            )

    @property
    def bounds(self) -> tuple[float, float]:
        """(low, high)."""
        return float(self.low), float(self.high)


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

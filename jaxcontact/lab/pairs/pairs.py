"""Measured pairs of closing speed and restitution, as plain data."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ...extend import Floats

Ints = NDArray[np.int64]

LEAST_PAIRS = 4
"""One parameter of the law, two of the noise, and one degree of freedom to judge the fit."""

_NEEDED = (
    "is needed",
    "are needed (one parameter of the law, two of the noise, one to test the fit)",
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pairs:
    """n measured pairs; every array has the shape (n,).

    `velocity` is the approach speed in m/s and `restitution` the measured e. `reading_factor`
    propagates reading errors: a standard deviation σ gives ln e the variance σ² · `reading_factor`.
    `cluster` numbers the group of pairs that share errors, with the names `cluster_names`. For
    known reading errors, `covariance` (n, n) is the resulting one of ln e, and `reading` their
    typical size. `absolute`: whether that is all of the noise.
    """

    velocity: Floats
    restitution: Floats
    reading_factor: Floats
    cluster: Ints
    cluster_names: tuple[str, ...]
    covariance: Floats | None = None
    reading: float = 0.0
    absolute: bool = False

    @property
    def words(self) -> tuple[str, str]:
        """The noun for one pair and for several."""
        return "pair of speed and restitution", "pairs of speed and restitution"

    @property
    def owner(self) -> str:
        """` of NAME` for pairs of a ball with a name."""
        return ""

    @property
    def rule(self) -> str:
        """The rule by which readings make a pair."""
        return "each row is a pair"

    @property
    def from_flights(self) -> bool:
        """True if speeds follow from flights of a ball."""
        return False

    def guess(self, flagged: NDArray[np.bool_], e: float) -> Mapping[int, str]:
        """Return likely causes of the flagged pairs, by number; `e` is the usual restitution."""
        return {}

    def __len__(self) -> int:
        return len(self.velocity)

    def where(self, keep: NDArray[np.bool_]) -> Pairs:
        """Return the pairs for which `keep` (n,) is True."""
        kept = {name: x[keep] for name, x in vars(self).items() if isinstance(x, np.ndarray)}
        if self.covariance is not None:
            kept["covariance"] = self.covariance[np.ix_(keep, keep)]
        return dataclasses.replace(self, **kept)

    def needs_enough(self, marked: int = 0, least: int = LEAST_PAIRS) -> None:
        """Raise ValueError for fewer pairs than `least`; `marked` ones were left out before."""
        count = len(self)
        if count >= least:
            return
        left_out = f"; {marked} more are off the trend and left out" if marked else ""
        raise self.fault(
            f"{count} usable {self.words[count != 1]}{self.owner}, but at least "
            f"{least} {_NEEDED[least > 1]}{left_out}; {self.rule}; add rows"
        )

    def fault(self, problem: str) -> ValueError:
        """Return the error for a problem of these pairs."""
        return ValueError(problem)


def pairs_of(velocity: Floats, restitution: Floats, sigma: Floats | None = None) -> Pairs:
    """Return pairs of columns (n,); `sigma` are standard deviations of e, all of their noise."""
    count = len(velocity)
    return Pairs(
        velocity=velocity,
        restitution=restitution,
        reading_factor=np.zeros(count),
        cluster=np.arange(count),
        cluster_names=tuple(f"row {k + 1}" for k in range(count)),
        covariance=None if sigma is None else np.diag((sigma / restitution) ** 2),
        absolute=sigma is not None,
    )

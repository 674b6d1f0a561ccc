"""Measured pairs of closing speed and restitution as plain data, and the scatter of ln e.

It has a relative part from the bounce itself and an absolute reading error. A trigger is delayed by
a time and a height is misread by a length, which matter more in short flights:

    var(ln e) = s₀² + σ² q

with q the `reading_factor` of the pair, s₀ dimensionless, and σ in the unit of the reading.
"""

from __future__ import annotations

import dataclasses
import math
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

    `velocity` is the closing speed in m/s and `restitution` the measured e. `reading_factor`
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


def standardised(covariance: Floats) -> tuple[Floats, Floats]:
    """Return the standard deviations (n,) and the correlation (n, n) of a covariance."""
    size = np.sqrt(np.diag(covariance))
    return size, covariance / np.outer(size, size)


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


ROBUST_DEGREES = 3.0
"""Degrees of freedom of the Student distribution that models scatter with outliers."""

RELATIVE_FLOOR = 1e-5
"""Lower bound of the scatter of ln e: published intervals are rounded to 1e-6 s in 0.1 s."""

_MOST_SCATTER = 1.0
_STEPS = 60

_SHARES = np.linspace(0.0, 1.0, 41)
_SCALE_STEPS = 200
_SCALE_TOLERANCE = 1e-10
_MAD_TO_SIGMA = 1.482602218505602  # 1/Φ⁻¹(3/4)


@dataclasses.dataclass(frozen=True)
class Noise:
    """`relative` is s₀, dimensionless; `reading` is σ, in the unit of the reading (s or m)."""

    relative: float
    reading: float

    def sigma(self, reading_factor: Floats) -> Floats:
        """Return the standard deviation of ln e, with the shape of `reading_factor`."""
        return np.sqrt(self.relative**2 + self.reading**2 * reading_factor)


def mad_sigma(values: Floats) -> float:
    """Return 1.4826 times the median absolute value: σ of normal scatter about 0, despite tails."""
    return _MAD_TO_SIGMA * float(np.median(np.abs(values)))


def estimate_noise(residual: Floats, reading_factor: Floats, *, robust: bool) -> Noise:
    """Return both scatters from residuals of ln e (n,) and their reading factors q (n,).

    Both maximise a likelihood over a grid of shares of the reading error; for each share the size
    follows by fixed-point iteration. With `robust` the likelihood is Student's (3 degrees of
    freedom). The size is then set so that the median absolute standardised residual is that of a
    normal distribution. Otherwise the likelihood is normal. The size is at least `RELATIVE_FLOOR`.
    """
    scale = float(np.mean(reading_factor))
    shares, scale = (_SHARES, scale) if scale > 0 else (_SHARES[:1], 1.0)
    shape = 1 - shares[:, None] + shares[:, None] * (reading_factor / scale)
    square = residual**2 / shape
    floor = RELATIVE_FLOOR**2
    if robust:
        size = np.maximum(np.median(square, axis=1), floor)
        for _ in range(_SCALE_STEPS):
            weight = (ROBUST_DEGREES + 1) / (ROBUST_DEGREES + square / size[:, None])
            last, size = size, np.maximum(np.mean(weight * square, axis=1), floor)
            if np.all(np.abs(size - last) <= _SCALE_TOLERANCE * size):
                break
    else:
        size = np.maximum(np.mean(square, axis=1), floor)
    standard = square / size[:, None]
    tail = standard / 2
    if robust:
        tail = (ROBUST_DEGREES + 1) / 2 * np.log1p(standard / ROBUST_DEGREES)
    best = int(np.argmin(np.sum(tail + np.log(shape * size[:, None]) / 2, axis=1)))
    total, share = float(size[best]), float(shares[best])
    if robust:
        total *= max(mad_sigma(np.sqrt(standard[best])) ** 2, floor / total)
    return Noise(math.sqrt(total * (1 - share)), math.sqrt(total * share / scale))


def scatter_beside(
    values: Floats, columns: Floats, covariance: Floats, *, least: float = RELATIVE_FLOOR
) -> float:
    """Return s₀ of values (n,) about a trend, the span of `columns` (n, k), beside known errors.

    The variance is V = s₀² I + `covariance` (n, n). s₀ maximises the restricted likelihood L with
    -2 ln L = ln|V| + ln|XᵀV⁻¹X| + rᵀV⁻¹r (Patterson & Thompson 1971, doi 10.1093/biomet/58.3.545).
    It is found on a grid of 0 and values from `least` on.
    """
    size, vectors = np.linalg.eigh(covariance)
    values, columns = vectors.T @ values, vectors.T @ columns
    grid = np.concatenate([[0.0], np.geomspace(least, _MOST_SCATTER, _STEPS)])
    best, lowest = 0.0, math.inf
    for one in grid:
        variance = np.maximum(size, 0.0) + max(one, 1e-3 * least) ** 2
        x, y = columns / np.sqrt(variance)[:, None], values / np.sqrt(variance)
        rest = y - x @ np.linalg.lstsq(x, y)[0]
        cost = float(np.sum(np.log(variance)) + rest @ rest + np.linalg.slogdet(x.T @ x)[1])
        if cost < lowest:
            best, lowest = float(one), cost
    return best

"""The measured columns of a choice among laws, their errors and contact; the fit of one kind."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike
from numpy.typing import NDArray

from ... import Contact, Fit, Positive, fit
from ...extend import POSITIVE, Floats, column, for_each, rendered
from ..pairs.outliers import Outliers
from ..pairs.pairs import (
    RELATIVE_FLOOR,
    Noise,
    Pairs,
    estimate_noise,
    scatter_beside,
    standardised,
)
from .kind import Kind, LogOutcomes, is_identifiable, padded
from .law_choice import LawFit

_BANDS = 4
"""Bands of speed that are left out in turn; each holds at least one pair."""

_TREND = 2
"""Degree of the trend of ln(contact time) or ln(force) over ln v, for the scatter."""


class Columns(NamedTuple):
    """Logarithms of what was measured beside e, by name, and their standard deviations.

    A missing reading has an infinite standard deviation.
    """

    values: dict[str, Floats]
    sigma: dict[str, Floats]

    def __bool__(self) -> bool:
        return bool(self.values)


NONE = Columns({}, {})


def columns_of(
    given: dict[str, tuple[ArrayLike | None, ArrayLike | None]],
    beside: tuple[str, Floats],
    sigma: ArrayLike | None,
    weights: ArrayLike | None,
) -> Columns:
    """Return the given columns; their relative errors are given, or scatter about a smooth trend.

    Raises ValueError for columns out of range, and for standard deviations of only some of them.
    """
    values, sizes = {}, {}
    for name, (measured, error) in given.items():
        if measured is None:
            if error is not None:
                raise ValueError(
                    f"Argument `sigma_{name}` must be None without `{name}`, but is "
                    f"{rendered(error)}."
                )
            continue
        if weights is not None:
            raise ValueError(
                f"Argument `weights` must be None with `{name}`, whose noise is another, but is "
                f"{rendered(weights)}; give `sigma` and `sigma_{name}`, or neither."
            )
        if (error is None) != (sigma is None):
            missing = f"sigma_{name}" if error is None else "sigma"
            raise ValueError(
                f"Arguments `sigma` and `sigma_{name}` must be given both or neither, but "
                f"`{missing}` is None."
            )
        readings = np.log(column(measured, name, POSITIVE, beside, gaps=True))
        there = np.isfinite(readings)
        if error is None:
            size = np.full(len(readings), _scatter(readings[there], beside[1][there]))
        else:
            size = for_each(error, f"sigma_{name}", len(readings))
        values[name] = np.where(there, readings, 0.0)
        sizes[name] = np.where(there, size, np.inf)
    return Columns(values, sizes)


def _scatter(readings: Floats, velocity: Floats) -> float:
    """Return the standard deviation of readings about a polynomial of ln v."""
    degree = min(_TREND, len(np.unique(velocity)) - 1, len(readings) - 2)
    if degree < 0:
        return 1.0
    trend = np.polynomial.Polynomial.fit(np.log(velocity), readings, degree)
    left = readings - trend(np.log(velocity))
    return max(float(np.sqrt(left @ left / (len(left) - degree - 1))), RELATIVE_FLOOR)


class PairErrors(NamedTuple):
    """The errors of ln e of n pairs.

    `noise` is that about the trend. `sigma` (n,) are standard deviations, relative ones unless
    `absolute`. `correlation` (n, n) is None for independent pairs. `others` were measured with the
    pairs; with them the correlation is (columns n, columns n).
    """

    noise: Noise
    sigma: Floats
    absolute: bool = False
    correlation: Floats | None = None
    others: Columns = NONE


def errors_of(pairs: Pairs, outliers: Outliers, keep: NDArray[np.bool_]) -> PairErrors:
    """Return the errors of all pairs, from the scatter about the trend of the pairs `keep`.

    Known errors of the readings are used unchanged, with what pairs share of them. The scatter of
    the bounces is estimated in addition, unless the errors contain it.
    """
    good, trend = pairs.where(keep), outliers.trend
    if pairs.absolute and pairs.covariance is not None:
        size, correlation = standardised(pairs.covariance)
        if not pairs.reading:  # to third order, σ/√(e e₀) of ln e is the σ of e
            size = size * np.sqrt(pairs.restitution / np.exp(trend(pairs.velocity)))
        usual = 0.0 if pairs.reading else float(np.median(size[keep]))
        alone = not np.any(np.triu(correlation, 1))
        return PairErrors(Noise(usual, pairs.reading), size, True, None if alone else correlation)
    if pairs.covariance is not None and good.covariance is not None:
        relative = scatter_beside(
            np.log(good.restitution), trend.columns(good.velocity), good.covariance
        )
        whole = pairs.covariance + max(relative, RELATIVE_FLOOR) ** 2 * np.eye(len(pairs))
        size, correlation = standardised(whole)
        return PairErrors(Noise(relative, pairs.reading), size, correlation=correlation)
    residual = np.log(good.restitution) - trend(good.velocity)
    noise = estimate_noise(residual, good.reading_factor, robust=False)
    return PairErrors(noise, noise.sigma(pairs.reading_factor))


@dataclasses.dataclass(frozen=True)
class ChoiceTable:
    """Pairs to choose a law from: those in `use` (n,), with the errors of all, and the contact.

    `known` names the numbers of the contact that were given. `options` are those of `fit`, and
    `group` is the word for a trial. Pairs without weight pad the data to a few lengths. Leaving
    pairs out (outliers, bands of speed) changes only weights, so each kind of law has one compiled
    search.
    """

    pairs: Pairs
    use: NDArray[np.bool_]
    errors: PairErrors
    contact: Contact
    known: frozenset[str] = frozenset({"mass", "stiffness"})
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    group: str = "trial"

    @property
    def velocity(self) -> Floats:
        """The closing speeds in m/s of the pairs in use."""
        return self.pairs.velocity[self.use]

    @property
    def reference(self) -> float:
        """The speed in m/s to which the c of a power law belongs."""
        return float(np.exp(np.mean(np.log(self.velocity))))

    @functools.cached_property
    def data(self) -> dict[str, Any]:
        """The arguments of `fit`: ln e first, then the other measured columns."""
        pairs, errors = self.pairs, self.errors
        sizes = [
            np.where(self.use, one, np.inf) for one in (errors.sigma, *errors.others.sigma.values())
        ]
        if errors.absolute:
            noise = {"sigma": tuple(padded(one, np.inf) for one in sizes)}
        else:
            noise = {"weights": tuple(padded(one**-2, 0.0) for one in sizes)}
        columns = np.log(pairs.restitution), *errors.others.values.values()
        data: dict[str, Any] = {"data": tuple(padded(one, 0.0) for one in columns), **noise}
        if not errors.others:
            data = {name: one for name, (one,) in data.items()}
        x = padded(pairs.velocity, float(np.median(pairs.velocity)))
        if errors.correlation is not None:
            whole = np.eye(len(x) * len(columns))
            places = [k * len(x) + np.arange(len(pairs)) for k in range(len(columns))]
            whole[np.ix_(np.concatenate(places), np.concatenate(places))] = errors.correlation
            data["correlation"] = whole
        return {**data, "x": x, "groups": self._groups(len(columns)), **self.options}

    def _groups(self, columns: int) -> NDArray[np.int64]:
        """Return the trial number of each padded point; readings of one impact are independent."""
        trial = self.pairs.cluster
        own = padded(trial, -1)
        if len(np.unique(trial)) < len(trial):
            return np.tile(own, columns)
        return np.concatenate([own + k * (own.max() + 1) for k in range(columns)])

    def bands(self, found: Fit) -> NDArray[np.bool_]:
        """Return which of the padded points of a fit each band of speed leaves out (bands, n)."""
        place = np.flatnonzero(self.use)
        order = place[np.argsort(self.velocity, kind="stable")]
        parts = np.zeros((min(_BANDS, len(place)), len(self.data["x"])), bool)
        for part, band in zip(parts, np.array_split(order, len(parts)), strict=True):
            part[band] = True
        used = np.asarray(found.problem.factor) > 0
        return np.tile(parts, used.size // parts.shape[1]) & used

    def determines(self, kind: Kind) -> bool:
        """Return whether AICc is finite: n > k + 1 readings, one more for unknown noise."""
        others = self.errors.others
        readings = len(self.velocity)
        readings += sum(int(np.isfinite(one[self.use]).sum()) for one in others.sigma.values())
        numbers = len(kind.transforms) + bool(others)
        return readings > numbers + (1 if self.errors.absolute else 2)

    def fit(self, kind: Kind) -> Fit:
        """Fit a kind of law; with contact times or peak forces, the stiffness too."""
        fields = tuple(self.errors.others.values)
        typical = min(max(float(np.median(self.pairs.restitution[self.use])), 0.05), 0.999)
        transforms = kind.transforms
        # Threads do not inherit the precision in which a caller made the contact.
        with jax.enable_x64(True):
            starts = kind.starts(typical, self.contact, self.reference)
            model = LogOutcomes(kind, self.contact, jnp.asarray(self.reference), fields)
        if fields:
            transforms["stiffness"] = Positive()
        found = []
        for start in starts:
            if fields:
                start = {**start, "stiffness": float(self.contact.stiffness)}
            found.append(fit(model, start=start, transforms=transforms, throw=False, **self.data))
        return min(found, key=lambda one: (not one.converged, one.loss))

    def law_fit(self, kind: Kind, found: Fit) -> LawFit:
        """Return the fit of a kind as plain numbers and words."""
        measured = self.pairs.restitution[self.use]
        at_pairs = measured * np.exp(found.residuals[: len(self.use)][self.use])
        speed = float(np.median(self.velocity))
        by = "point" if found.problem.whitener is None else "readings"
        return LawFit(
            kind=kind.name,
            law=kind.law,
            estimates=kind.estimates(found, self.contact, self.known, speed),
            errors_by="group" if found.by_group else by,
            identifiable=found.converged and is_identifiable(found),
            unidentified=kind.unidentified,
            rms=float(np.sqrt(np.mean((measured - at_pairs) ** 2))),
            reduced_chi2=2 * found.loss / max(found.dof, 1),
            adequate=found.adequate,
            grounds=found.adequacy.grounds,
            converged=found.converged,
            reason=found.reason,
            steps=found.steps,
            determined=len(kind.parameters),
        )

"""Instrument noise: low-pass filters correlate it, and resolution steps round readings.

Noise of standard deviation σ has the covariance C = σ² ((1 - s) I + s R). The share s has passed a
low-pass filter, and R is the correlation behind it. Rounding to steps q with a uniformly random
zero adds

    Q_ij = Σ_k q²/(2π²k²) cos(2πk (μ_i - μ_j)/q) exp(-2π²k² (C_ii + C_jj - 2 C_ij)/q²)

for readings with expectation μ. This is q²/12 for each reading, shared by readings between which
neither signal nor noise moves by a step. It is the covariance of the Fourier series of rounding
(Widrow, Kollár & Liu 1996, doi 10.1109/19.492748).

Fits weight readings as if rounding were independent. Weights Q⁻¹ would cancel rounding errors by
the position within a step that the fit itself predicts, and the fit would be overconfident.
Standard errors are computed with Q.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ... import Fit
from ...extend import AbstractErrors, SharedErrors, basis_of, with_shared
from ..pairs.shared_noise import shared_noise, slope_of
from .low_pass import Limits, LowPass

Column = Float[np.ndarray, " n"]

_NOTICED = 1 / 3
"""Steps above this fraction of the scatter of a column are treated as noise."""

_SHARED = 2.0
"""Steps below this many standard deviations share no rounding error: at most exp(-π²) remains."""

_LEAST = 0.05
"""Least noise in steps; less would leave readings that share one error."""

_PARTS = np.geomspace(0.05, 0.6, 9)
"""Standard deviations of noise in steps, between which rounding determines the noise."""

_PASSED = 0.999
"""Fraction of the noise before rounding that has passed the filter."""

_TERMS = 12
_MOST = 2000
"""Largest number of readings with a correlation matrix."""

_SAME = 1e-2
"""Largest change of all correlations at convergence."""

_WHOLE = 1e-3
"""Tolerance in steps within which a gap is a multiple of the step."""

_ORDINALS = {2: "nd", 3: "rd"}

_ROUNDED, _NOTHING = 1e-9, 1e-300


class _CorrelatedNoise(NamedTuple):
    """Standard deviations (n,) of readings, their correlation (n, n) and their full errors.

    A fit weighs by the correlation (None without one). `whole` holds all errors if rounding shares
    more.
    """

    size: Column
    correlation: Float[np.ndarray, "n n"] | None
    whole: SharedErrors | None


def require_filterable(name: str, readings: Column | None) -> None:
    """Raise ValueError for a filter without a column, or for one with too many readings."""
    if readings is None:
        raise ValueError(f"Argument `low_pass_{name}` must be None without `{name}`.")
    if readings.size > _MOST:
        every = math.ceil(readings.size / _MOST)
        raise ValueError(
            f"Argument `{name}` must have at most {_MOST} readings with `low_pass_{name}`, but "
            f"has {readings.size}; give every {every}{_ORDINALS.get(every, 'th')}, as a filter "
            "leaves little between them."
        )


def step_of(readings: Column) -> float:
    """Return the resolution step of a column, 0 if it has none.

    All readings must lie on multiples of the step from one of them, and some must coincide.
    """
    values = np.unique(readings)
    gaps = np.diff(values)
    gaps = gaps[gaps > _ROUNDED * np.ptp(values)]
    if gaps.size < 2 or gaps.size + 1 >= readings.size:
        return 0.0
    # The mean of single-step gaps is more accurate than the smallest gap.
    step = float(np.mean(gaps[gaps < 1.5 * gaps.min()]))
    whole = np.abs(gaps / step - np.round(gaps / step)) < _WHOLE * np.maximum(1, gaps / step)
    return step if whole.all() else 0.0


def rounding(
    noise: Float[np.ndarray, "n n"], expected: Column, step: float
) -> Float[np.ndarray, "n n"]:
    """Return the covariance Q (n, n) of rounding to steps; `noise` is C and `expected` is μ."""
    size = np.diag(noise)
    apart = (size[:, None] + size - 2 * noise) / step**2
    turn = 2 * np.pi * (expected[:, None] - expected) / step
    total = np.zeros_like(noise)
    for k in range(1, _TERMS + 1):
        total += np.cos(k * turn) * np.exp(-2 * (np.pi * k) ** 2 * apart) / (2 * (np.pi * k) ** 2)
    # The omitted terms of q²/12 are small and are treated as independent.
    total[np.diag_indices_from(total)] = 1 / 12
    return step**2 * total


def rounding_of_white_noise(sigma: Column, expected: Column, step: float) -> SharedErrors:
    """Return the errors C + Q of readings with independent noise `sigma` (n,), rounded to steps.

    They are a diagonal plus a product of a few columns, small for any number of readings:
    exp(-2π²k² (σ_i² + σ_j²)/q²) is a product, and the cosine of a difference is a sum of two.
    """
    turns = np.arange(1, _TERMS + 1)
    kept = np.exp(-2 * (np.pi * sigma[:, None] * turns / step) ** 2) / (np.sqrt(2) * np.pi * turns)
    turn = 2 * np.pi * expected[:, None] * turns / step
    root = step * np.concatenate([kept * np.cos(turn), kept * np.sin(turn)], axis=1)
    return SharedErrors(sigma**2 + step**2 / 12 - np.sum(root**2, axis=1), root)


class InstrumentErrors(AbstractErrors[Fit, dict[str, Any]]):
    """The correlated noise of filters and steps; nothing without filter and noticeable step.

    `table` holds the readings by column, and their standard deviations if these are known.
    """

    rounds = 6

    def __init__(
        self, table: Mapping[str, Mapping[str, Any]], time: Column, limits: Mapping[str, Limits]
    ):
        self._columns = [
            _RecordColumn(
                name,
                slice(i * time.size, (i + 1) * time.size),
                step_of(readings[~limits[name].at_limit]),
                table["sigma"][name] if "sigma" in table else None,
                time,
            )
            for i, (name, readings) in enumerate(table["data"].items())
        ]
        self._last = np.zeros(0)
        self._noises: dict[str, _CorrelatedNoise] = {}

    def estimate(self, found: Fit) -> dict[str, Any] | None:
        """Return the standard deviations and the correlation of the readings."""
        if not found.converged:
            return None
        noises = {one.name: one.noise_of(found) for one in self._columns}
        self._noises = {name: noise for name, noise in noises.items() if noise is not None}
        errors, numbers = self._errors()
        last, self._last = self._last, numbers
        same = last.size > 0 and np.max(np.abs(numbers - last)) < _SAME
        return None if same or not errors else errors

    def _errors(self) -> tuple[dict[str, Any], Float[np.ndarray, " numbers"]]:
        """Return the arguments of `fit`, {} if the noise is as given, and all their numbers."""
        errors: dict[str, Any] = {}
        for one in self._columns:
            noise = self._noises.get(one.name)
            if noise is not None and noise.correlation is not None:
                whole = errors.setdefault("correlation", np.eye(self._columns[-1].rows.stop))
                whole[one.rows, one.rows] = noise.correlation
        sigmas = {one.name: one.sigma for one in self._columns if one.sigma is not None}
        for name in sigmas.keys() & self._noises.keys():
            sigmas[name] = np.where(np.isfinite(sigmas[name]), self._noises[name].size, np.inf)
        if sigmas and self._noises:
            errors["sigma"] = sigmas
        sizes = [np.log(one[np.isfinite(one)]) for one in sigmas.values()]
        return errors, np.concatenate([errors.get("correlation", np.zeros(0)).ravel(), *sizes])

    def finish(self, found: Fit) -> Fit:
        """Return the fit with the errors that rounding shares, and notes on steps."""
        if not found.converged:
            return found
        if any(noise.whole is not None for noise in self._noises.values()):
            found = with_shared(found, self._errors_of_z(found))
        said = [
            f"readings of {one.name} are rounded to steps of {one.step:.3g}, {part:.2g} of their "
            "scatter: their noise includes the rounding"
            for one in self._columns
            if (part := one.step / one.scatter(found)) > _NOTICED
        ]
        return dataclasses.replace(found, notes=(*found.notes, *said))

    def _errors_of_z(self, found: Fit) -> SharedErrors:
        """Return the errors of standardised residuals with weight, including shared rounding."""
        factor, whitener = np.asarray(found.problem.factor), found.problem.whitener
        used, own = factor > 0, np.full(factor.size, found.noise)
        roots = [np.zeros((factor.size, 0))]
        for column in self._columns:
            rows, noise = column.rows, self._noises.get(column.name)
            if noise is None or (whole := noise.whole) is None:
                continue
            root = np.zeros((factor.size, whole.root.shape[1]))
            root[rows] = whole.root * factor[rows, None]
            if column.filter_of(found) is not None:
                # Only filtered noise is whitened, and it has no error of its own.
                root[rows] = np.asarray(whitener)[rows, rows] @ root[rows]
            own[rows] = whole.own * factor[rows] ** 2
            roots.append(root)
        return SharedErrors(own[used], np.concatenate(roots, axis=1)[used])


class _RecordColumn(NamedTuple):
    """A column of a record: rows in the fit, step (0 without) and known standard deviations (n,).

    The standard deviations are None if the fit estimates the noise.
    """

    name: str
    rows: slice
    step: float
    sigma: Column | None
    time: Column

    def filter_of(self, found: Fit) -> LowPass | None:
        return getattr(found.params, f"low_pass_{self.name}")

    def scatter(self, found: Fit) -> float:
        """Return the standard deviation of the residuals."""
        return max(float(np.sqrt(np.nanmean(found.residuals[self.rows] ** 2))), _NOTHING)

    def noise_of(self, found: Fit) -> _CorrelatedNoise | None:
        """Return the noise; None if the readings are independent and as given."""
        factor, count = np.asarray(found.problem.factor), self.time.size
        used = np.zeros(factor.size, bool)
        used[self.rows] = factor[self.rows] > 0
        step = self.step if self.step > _NOTICED * self.scatter(found) else 0.0
        low_pass = self.filter_of(found)
        if low_pass is None and not step:
            return None
        if self.sigma is None:
            total = found.noise / float(np.median(factor[used])) ** 2
            alone = max(total - step**2 / 12, (_LEAST * step) ** 2)
            sigma = np.full(count, math.sqrt(alone))
        else:
            sigma = np.where(np.isfinite(self.sigma), self.sigma, 1.0)
        passed = None
        if low_pass is not None:
            shape = np.eye(factor.size)
            shape[self.rows, self.rows] = behind = low_pass.correlation(self.time)
            # With steps, the unfiltered part of the noise is their rounding.
            share = _PASSED if step else shared_noise(found, used, shape).share
            passed = (1 - share) * np.eye(count) + share * behind
        whole = None
        if step and (passed is not None or step > _SHARED * np.median(sigma)):
            expected = np.asarray(found.predict()[self.name])
            if self.sigma is None:
                sigma = np.full(count, step * self._part_of(found, used, passed, expected))
            whole = _rounding_errors(sigma, passed, expected, step)
        size = np.sqrt(sigma**2 + step**2 / 12)
        if passed is not None:
            passed = passed * np.outer(sigma / size, sigma / size)
            np.fill_diagonal(passed, 1)
        return _CorrelatedNoise(size, passed, whole)

    def _part_of(
        self,
        found: Fit,
        used: Bool[np.ndarray, " n"],
        passed: Float[np.ndarray, "n n"] | None,
        expected: Column,
    ) -> float:
        """Return the noise before rounding, in steps, by restricted likelihood.

        The size of the residuals alone does not determine it, because readings share rounding
        errors that the parameters follow. Its logarithm is averaged with the likelihood.
        """
        residual = found.residuals[used] / self.step
        seen = np.column_stack([basis_of(slope_of(found)[used]), residual])
        rows = np.flatnonzero(used) - self.rows.start
        some = None if passed is None else passed[np.ix_(rows, rows)]
        expected = expected[rows] / self.step
        logs = np.array([
            _log_likelihood(_rounding_errors(np.full(rows.size, part), some, expected, 1.0), seen)
            for part in _PARTS
        ])  # fmt: skip
        weight = np.exp(logs - logs.max())
        return float(np.exp(weight @ np.log(_PARTS) / weight.sum()))


def _rounding_errors(
    sigma: Column, passed: Float[np.ndarray, "n n"] | None, expected: Column, step: float
) -> SharedErrors:
    """Return the errors of rounded readings; `passed` is the filtered correlation or None."""
    if passed is None:
        return rounding_of_white_noise(sigma, expected, step)
    noise = passed * np.outer(sigma, sigma)
    root = np.linalg.cholesky(noise + rounding(noise, expected, step))
    return SharedErrors(np.zeros(sigma.size), root)


def _log_likelihood(errors: SharedErrors, seen: Float[np.ndarray, "n k+1"]) -> float:
    """Return the restricted log-likelihood of the last column of `seen` given the others."""
    if errors.own.any():
        # Woodbury's identity: the linear system has only as many rows as shared columns.
        size = np.sqrt(errors.own)[:, None]
        root, seen = errors.root / size, seen / size
        inner = np.eye(root.shape[1]) + root.T @ root
        along = root.T @ seen
        products = seen.T @ seen - along.T @ np.linalg.solve(inner, along)
        volume = np.log(errors.own).sum() + np.linalg.slogdet(inner)[1]
    else:
        white = np.linalg.solve(errors.root, seen)
        products = white.T @ white
        volume = 2 * np.log(np.diag(errors.root)).sum()
    moved, pull = products[:-1, :-1], products[:-1, -1]
    left = products[-1, -1] - pull @ np.linalg.solve(moved, pull)
    return -float(left + volume + np.linalg.slogdet(moved)[1]) / 2

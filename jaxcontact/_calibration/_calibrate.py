"""Calibration: which constant e, or which speed-dependent law, a recording of bounces supports."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._flight import STANDARD_GRAVITY, Drag, Flight, Floats, require_positive
from .._measurements._noise import Noise, estimate_noise
from .._measurements._outliers import Outliers, find_outliers
from .._measurements._pairs import Pairs, make_pairs
from .._measurements._recording import Recording
from ._asked import Asked, asked_of
from ._curves import Curve, Misfit, choose_curves, evaluate
from ._minimise import Minimum, minimise
from ._statistics import ErrorKind, Line, aicc, bic, fit_line, information, preference

GRID = 200

CLEAR_AICC = 2.0
"""Below this difference of AICc two fits count as equally good (Burnham & Anderson 2002)."""

CLEAR_PREFERENCE = 2.0
"""The same for the advantage summed over trials, in its standard errors."""

_BANDS = 4
"""Bands of speed that are left out in turn; every one holds a pair."""

_SHORTEST = 256
"""Fits of up to this many pairs share one compiled code; a thousand times as fast as compiling."""

_WIDEST_LOGARITHM = 2.0
"""A fitted number whose logarithm (or logit) is known no better than this is not determined."""


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A number with its standard error (None where the data do not determine it) and unit."""

    name: str
    value: float
    standard_error: float | None
    unit: str


@dataclasses.dataclass(frozen=True)
class LawFit:
    """One law fitted to n pairs.

    `estimates`: the fitted number first, then what follows from it. `error_kind` says how standard
    errors were found. `rms` is the plain root mean square of e_measured - e(v). `reduced_chi2` is
    Σ z²/(n-1) for z the residuals of ln e over their noise; `held_out` is the root mean square of z
    of pairs that were left out, one band of speeds after the other; `grid` and `grid_error` are e
    and its standard error on the speeds of the calibration's grid.
    """

    curve: Curve
    estimates: tuple[Estimate, ...]
    error_kind: ErrorKind
    determined: bool
    converged: bool
    reason: str
    evaluations: int
    gradient_norm: float
    rms: float
    reduced_chi2: float
    aicc: float
    bic: float
    held_out: float
    standard_residuals: Floats
    grid: Floats
    grid_error: Floats | None


@dataclasses.dataclass(frozen=True)
class Comparison:
    """A speed-dependent law against the constant e.

    `difference` is AICc of the speed-dependent law minus that of the constant e: positive where a
    constant e wins. `by_trial` is the advantage of the constant e summed over trials, in its
    standard errors (None with too few trials). `verdict` says it in words.
    """

    constant: str
    other: str
    difference: float
    by_trial: float | None
    verdict: str


@dataclasses.dataclass(frozen=True)
class FitSet:
    """All laws fitted to one choice of pairs, the yardstick line, and the comparisons."""

    count: int
    fits: tuple[LawFit, ...]
    line: Line
    comparisons: tuple[Comparison, ...]


@dataclasses.dataclass(frozen=True)
class Calibration:
    """What a recording says about laws.

    `pairs` are all pairs, `outliers` which of them the robust rule marked; `kept` are the fits
    without those and `everything` those with them; `noise` is the scatter found in the kept pairs;
    `grid` are the speeds (m/s) of the curves in the fits; `asked` is what each law of constant e is
    to be asked for, to deliver the constant e found.
    """

    pairs: Pairs
    outliers: Outliers
    noise: Noise
    grid: Floats
    kept: FitSet
    everything: FitSet
    mass: float | None
    stiffness: float | None
    asked: tuple[Asked, ...]

    @property
    def converged(self) -> bool:
        """Whether every fit converged."""
        return all(fit.converged for fits in (self.kept, self.everything) for fit in fits.fits)


def calibrate(
    recording: Recording,
    *,
    law: str | None = None,
    gravity: float = STANDARD_GRAVITY,
    drag: Drag | None = None,
    mass: float | None = None,
    stiffness: float | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> Calibration:
    """Fit a constant e and speed-dependent laws to a recording of bounces, and compare them.

    Minimises Σ ((ln e_k - ln e(v_k; θ))/σ_k)² over the one number θ of each law that e(v) can fix,
    by L-BFGS in double precision. Pairs that a robust rule marks (spurious and missed triggers) are
    left out; the same fits with them are made too. σ_k is the scatter of the bounce and the reading
    error of that interval or height, both estimated from the pairs.

    Arguments: `law`, see `choose_curves`; `gravity`
    in m/s²; `drag` to take the air out of the flights; `mass` in kg and `stiffness` in N/m^(3/2) to
    report the A or c that follow; `progress`, called with a line of text at each stage. Raises
    RecordingError for a recording that cannot be used and ValueError for other arguments out of
    range.
    """
    curves = choose_curves(law)
    for argument, value in (("mass", mass), ("stiffness", stiffness)):
        if value is not None:
            require_positive(argument, value)
    flight = Flight(gravity, drag)
    pairs = make_pairs(recording, flight)
    pairs.needs_enough()
    progress(f"looking for spurious and missed triggers in {len(pairs)} pairs")
    outliers = find_outliers(pairs)
    good = pairs.where(~outliers.flagged)
    good.needs_enough(marked=int(outliers.flagged.sum()))
    noise = estimate_noise(
        np.log(good.restitution) - outliers.trend(good.velocity), good.reading_factor, robust=False
    )
    grid = np.linspace(float(good.velocity.min()), float(good.velocity.max()), GRID)
    # A fit needs double precision; the user's own setting stays as it is.
    with jax.enable_x64(True):
        problem = _Problem(pairs, noise, grid, mass, stiffness)
        kept, everything = [], []
        for curve in curves:
            progress(f"compiling and fitting {curve.label}")
            kept.append(problem.fit(curve, ~outliers.flagged))
            everything.append(problem.fit(curve, np.ones(len(pairs), dtype=bool)))
    return Calibration(
        pairs=pairs,
        outliers=outliers,
        noise=noise,
        grid=grid,
        kept=_fit_set(good, noise, kept),
        everything=_fit_set(pairs, noise, everything),
        mass=mass,
        stiffness=stiffness,
        asked=_asked(kept[0]),
    )


def _asked(constant: LawFit) -> tuple[Asked, ...]:
    # The last estimate of a constant law is the e that is delivered.
    delivered = constant.estimates[-1]
    return asked_of(delivered.value, delivered.standard_error)


def _padded_length(n: int) -> int:
    """The least power of two that holds n, and 256 at least."""
    return max(_SHORTEST, 1 << (n - 1).bit_length())


@dataclasses.dataclass(frozen=True)
class _Problem:
    pairs: Pairs
    noise: Noise
    grid: Floats
    mass: float | None
    stiffness: float | None

    def fit(self, curve: Curve, use: np.ndarray) -> LawFit:
        pairs = self.pairs
        y = np.log(pairs.restitution)
        sigma = self.noise.sigma(pairs.reading_factor)
        middle = float(np.median(pairs.velocity[use]))
        start = curve.start(float(np.median(pairs.restitution[use])), middle)
        minimum = self._minimum(curve, start, use)
        n = len(pairs)
        e, slope = self._evaluated(curve, minimum.parameters, middle)
        grid_e, grid_slope = e[-GRID - 1 : -1], slope[-GRID - 1 : -1]
        at_pairs, log_slope = e[:n][use], (slope[:n] / e[:n])[use]
        z = (y[use] - np.log(at_pairs)) / sigma[use]
        known = information(z, log_slope / sigma[use], pairs.cluster[use])
        theta_error = math.sqrt(known.variance)
        determined = theta_error < _WIDEST_LOGARITHM
        error = theta_error if determined else None
        return LawFit(
            curve=curve,
            estimates=self._estimates(
                curve, minimum.parameters, error, float(e[-1]), float(slope[-1]), middle
            ),
            error_kind=known.kind,
            determined=determined,
            converged=minimum.converged,
            reason=minimum.reason,
            evaluations=minimum.evaluations,
            gradient_norm=minimum.gradient_norm,
            rms=float(np.sqrt(np.mean((pairs.restitution[use] - at_pairs) ** 2))),
            reduced_chi2=float(np.sum(z**2)) / (len(z) - 1),
            aicc=aicc(z, sigma[use], 1),
            bic=bic(z, sigma[use], 1),
            held_out=self._held_out(curve, minimum.parameters, use),
            standard_residuals=z,
            grid=grid_e,
            grid_error=None if error is None else np.abs(grid_slope) * error,
        )

    def _minimum(self, curve: Curve, start: Array, use: np.ndarray) -> Minimum:
        # Infinite noise leaves a pair out without changing a shape. Padded with such pairs to few
        # lengths, recordings share the compiled code, which takes longer than the fits.
        pairs = self.pairs
        sigma = np.where(use, self.noise.sigma(pairs.reading_factor), np.inf)
        return minimise(
            Misfit(curve),
            start,
            jnp.asarray(self._padded(pairs.velocity, float(np.median(pairs.velocity)))),
            jnp.asarray(self._padded(np.log(pairs.restitution), 0.0)),
            jnp.asarray(self._padded(sigma, np.inf)),
        )

    def _padded(self, values: Floats, filling: float) -> Floats:
        spare = _padded_length(len(values)) - len(values)
        return np.concatenate([values, np.full(spare, filling)])

    def _evaluated(self, curve: Curve, theta: Array, middle: float) -> tuple[Floats, Floats]:
        """e and its slope at all pairs (padded), on the grid, and at `middle`."""
        speeds = np.concatenate([self._padded(self.pairs.velocity, middle), self.grid, [middle]])
        e, slope = evaluate(curve, theta, jnp.asarray(speeds))
        return np.asarray(e), np.asarray(slope)

    def _held_out(self, curve: Curve, start: Array, use: np.ndarray) -> float:
        """The root mean square z of pairs left out: whether the others foretell their speeds."""
        pairs = self.pairs
        place = np.flatnonzero(use)
        bands = np.array_split(place[np.argsort(pairs.velocity[use], kind="stable")], _BANDS)
        sigma = self.noise.sigma(pairs.reading_factor)
        square = 0.0
        for band in bands:
            rest = use.copy()
            rest[band] = False
            theta = self._minimum(curve, start, rest).parameters
            e = self._evaluated(curve, theta, 1.0)[0][: len(pairs)]
            z = (np.log(pairs.restitution) - np.log(e)) / sigma
            square += float(np.sum(z[band] ** 2))
        return math.sqrt(square / len(place))

    def _estimates(
        self,
        curve: Curve,
        theta: Array,
        error: float | None,
        e: float,
        slope: float,
        velocity: float,
    ) -> tuple[Estimate, ...]:
        def scaled(name: str, value: float, derivative: float, unit: str) -> Estimate:
            return Estimate(name, value, None if error is None else abs(derivative) * error, unit)

        value = float(curve.value(theta))
        # θ is the logit of e or the logarithm of the number.
        derivative = value * (1 - value) if curve.kind == "constant" else value
        found = [scaled(curve.symbol, value, derivative, curve.unit)]
        if curve.kind == "constant":
            if curve.law != "exact":
                found.append(scaled("e delivered", e, slope, ""))
            return tuple(found)
        found.append(scaled(f"e at {velocity:.2f} m/s", e, slope, ""))
        if curve.kind == "constant_damping" and self.stiffness is not None:
            factor = self.stiffness
            found.append(scaled("c", value * factor, derivative * factor, "N s/m^(5/2)"))
        if curve.kind == "kuwabara_kono" and self.stiffness is not None and self.mass is not None:
            factor = (self.mass / self.stiffness) ** 0.4
            found.append(scaled("A", value * factor, derivative * factor, "s"))
        return tuple(found)


def _fit_set(pairs: Pairs, noise: Noise, fits: list[LawFit]) -> FitSet:
    line = fit_line(
        pairs.velocity,
        np.log(pairs.restitution),
        noise.sigma(pairs.reading_factor),
        pairs.cluster,
    )
    constant = fits[0]
    comparisons = tuple(_compare(constant, other, pairs) for other in fits[1:])
    return FitSet(len(pairs), tuple(fits), line, comparisons)


def _compare(constant: LawFit, other: LawFit, pairs: Pairs) -> Comparison:
    difference = other.aicc - constant.aicc
    by_trial = preference(constant.standard_residuals, other.standard_residuals, pairs.cluster)
    return Comparison(
        constant.curve.label,
        other.curve.label,
        difference,
        by_trial,
        _verdict(constant.curve.label, other.curve.label, difference, by_trial),
    )


def _verdict(constant: str, other: str, difference: float, by_trial: float | None) -> str:
    better, worse = (constant, other) if difference > 0 else (other, constant)
    size = f"AICc differs by {abs(difference):.1f}"
    if abs(difference) < CLEAR_AICC:
        return f"the data do not distinguish {constant} from {other} ({size})"
    if by_trial is None:
        return f"{better} describes the data better than {worse} ({size}; too few trials to check)"
    advantage = by_trial if difference > 0 else -by_trial
    trials = f"by trial {advantage:.1f} standard errors"
    if advantage < CLEAR_PREFERENCE:
        return f"undecided: {better} fits better than {worse} ({size}), but not surely ({trials})"
    return f"{better} describes the data better than {worse} ({size}; {trials})"

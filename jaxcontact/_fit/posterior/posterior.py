"""The posterior of the parameters of a fit, from data and prior."""

from __future__ import annotations

import dataclasses
import importlib.util
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..._entry import (
    FRACTION,
    rendered,
    require_choice,
    require_count,
    require_kind,
    require_number,
)
from ..._program import in_double
from ..._text.words import first_few, text_table
from ..data import FitData, require_converged
from ..search.minimum import ROUNDING, SINGULAR
from ..search.verdict import FAR, Direction
from ..uncertainty.adequacy import adequacy_of
from .density import Density, Draws, Mode, draw, find_mode, prior_of, root_of

_TAILS = 0.05, 0.95
_FEWEST = 4
"""Least draws of a chain whose halves have a variance."""


def r_hat_and_effective(draws: Float[np.ndarray, "chains draws"]) -> tuple[float, float]:
    """Return the rank-normalised split R-hat, and the smaller effective size of bulk and tails.

    R-hat is the larger of that of the draws and of their distances from the median. Both numbers
    are NaN for fewer than four draws of a chain, and for constant draws.
    """
    if draws.shape[1] < _FEWEST or not np.isfinite(draws).all() or np.ptp(draws) == 0:
        return np.nan, np.nan
    from arviz_stats.base.array import array_stats

    with np.errstate(divide="ignore", invalid="ignore"):  # chains that do not move
        bulk = array_stats.ess(draws, method="bulk")
        tail = array_stats.ess(draws, method="tail", prob=_TAILS)
        r_hat = np.asarray(array_stats.rhat(draws))
        return float(r_hat), float(np.minimum(bulk, tail))


LARGEST_R_HAT = 1.01
FEWEST_EFFECTIVE = 400
"""Limits that Vehtari et al. (2021) require for reliable draws."""

_PLACES = 5
_SHOWN = 1e-3
"""Component of a direction below which it is omitted from its words."""


@dataclasses.dataclass(frozen=True, repr=False)
class Posterior:
    """Draws of the parameters of a fit, and their diagnostics.

    `samples`: (chains, draws) by the name of a parameter, and "noise", σ of the standardised
    residuals, if it is unknown. `r_hat` and `effective_samples` (the smaller of the bulk's and the
    tails') by name. `divergences` among the draws. `evaluations` of the prediction with its
    derivatives by the chains, including the warm-up and the time they waited for each other.

    `converged`: every R-hat below 1.01, at least 400 effective samples, no divergence and no bound
    that a flat prior leaves open; `reason` in words. `fit` is the sampled fit.

    Source: Vehtari et al. (2021), doi 10.1214/20-BA1221.
    """

    samples: dict[str, np.ndarray]
    r_hat: dict[str, float]
    effective_samples: dict[str, float]
    divergences: int
    evaluations: int
    converged: bool
    reason: str
    fit: FitData = dataclasses.field(repr=False)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the samples."""
        return tuple(self.samples)

    @property
    def means(self) -> dict[str, float]:
        """The mean of each parameter."""
        return {name: float(draws.mean()) for name, draws in self.samples.items()}

    @property
    def standard_deviations(self) -> dict[str, float]:
        """The standard deviation of each parameter."""
        return {name: float(draws.std(ddof=1)) for name, draws in self.samples.items()}

    @property
    def params(self) -> Any:
        """The draws in the structure of the fit's params, each number (chains, draws)."""
        values = np.stack([self.samples[name] for name in self.fit.names], axis=-1)
        tree_of = self.fit.problem.space.tree_of
        with jax.enable_x64(True):
            return eqx.filter_vmap(eqx.filter_vmap(tree_of))(jnp.asarray(values))

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Return the central interval that holds `level` of the draws.

        Equally many draws lie below and above. Raises ValueError for an unknown name and a level
        outside (0, 1).
        """
        require_choice("name", name, self.names)
        level = require_number("level", level, FRACTION)
        low, high = np.quantile(self.samples[name], [(1 - level) / 2, (1 + level) / 2])
        return float(low), float(high)

    def to_dict(self) -> dict[str, np.ndarray]:
        """Return the draws (chains, draws) by name, for `arviz.from_dict(posterior=...)`."""
        return {name: draws.copy() for name, draws in self.samples.items()}

    def summary(self) -> str:
        """Return the posterior in words, with a line for each parameter."""
        good = "converged" if self.converged else "NOT CONVERGED"
        chains, draws = next(iter(self.samples.values())).shape
        lines = [
            f"Posterior: {good}, {self.reason}",
            f"  {chains * draws} draws of {chains} chains, {self.divergences} divergences, "
            f"{self.evaluations} evaluations",
        ]
        adequacy = adequacy_of(self.fit)
        if adequacy.adequate is False:
            words = str(adequacy)
            lines.insert(int(not self.converged), words[0].upper() + words[1:])
        means, widths = self.means, self.standard_deviations
        rows = []
        for name in self.names:
            places = _places(means[name], widths[name])
            mean, low, high = (f"{x:.{places}g}" for x in (means[name], *self.interval(name)))
            trust = _ratio(self.r_hat[name]), f"{self.effective_samples[name]:.0f}"
            width = f"± {widths[name]:.2g}"
            rows.append((name, mean, width, f"[{low}, {high}]", *trust))
        header = ("", "mean", "", "95 % in", "R-hat", "effective")
        return "\n".join(lines + text_table(rows, header=header, align="<><<>>", indent=2))

    __repr__ = summary


def posterior(
    fit: FitData,
    *,
    draws: int = 2000,
    chains: int = 4,
    warmup: int = 500,
    prior: Mapping[str, tuple[float, float]] | Callable[[Any], Any] | None = None,
    seed: int = 0,
) -> Posterior:
    """Sample the posterior of the parameters of a fit by the no-U-turn sampler.

    p(θ, σ | data) ~ p(θ) Π exp(-ρ(z/σ))/σ over the standardised residuals z, ρ = z²/2. With the
    fit's `sigma` the noise is known, σ = 1; otherwise σ is sampled too, with a prior flat in ln σ.
    For Huber's loss ρ is Huber's: noise that is normal in the middle and exponential beyond the
    threshold. That is a definite distribution, while the fit's standard errors assume none; σ is
    then relative to the scale that the fit used.

    Arguments: the fit; `draws`, the kept draws of each chain, and `warmup`, the discarded ones
    before them; `chains`, at least 2; `seed`. `prior`: None is flat in the fit's free coordinates
    θ: in ln c for a `Positive` c, in logit e for an e `Between` bounds, and in the others
    themselves. A dict {"e": (0.7, 0.05)} of means and standard deviations gives these parameters
    normal densities, truncated at their bounds. A function of the params (a law, a contact, a dict,
    as in the fit) returns the logarithm of their joint density. Both are densities of the
    parameters themselves: the change of variables |dx/dθ| is added here.

    A flat prior of a logarithm or a logit is improper. If the data do not exclude the bound, so is
    the posterior, and the result reports it. Chains begin around the fit: a mode that none of them
    reaches stays unknown.

    Computes in double precision regardless of the JAX setting, and does not work under `jit`. The
    same `predict` over data of the same shapes does not compile again, whatever `draws`, `warmup`
    and a prior by name; a new function does. Chains advance together, each draw as slow as that of
    the slowest.

    Returns a `Posterior`; check its `converged` first. Raises ImportError without blackjax and
    arviz-stats, which come with `pip install 'jaxcontact[posterior]'`. Raises ValueError for a fit
    that did not converge; for correlated points (`groups`, or coarse steps), which this likelihood
    takes as independent; for unknown noise without degrees of freedom; and if data and prior leave
    a direction open, or a parameter at its bound.

    Source: Hoffman & Gelman (2014), JMLR 15:1593; Huber (1964), doi 10.1214/aoms/1177703732.
    """
    require_kind("fit", fit, FitData, "a `Fit`")
    draws, chains = require_count("draws", draws, 1), require_count("chains", chains, 2)
    warmup, seed = require_count("warmup", warmup, 1), require_count("seed", seed, 0)
    _check(fit)
    with in_double(), jax.numpy_rank_promotion("allow"):
        known = prior_of(prior, fit.problem.space)
        if prior is None:
            _refuse_open(fit, np.zeros((len(fit.names),) * 2), prior)
        for module, name in (("blackjax", "blackjax"), ("arviz_stats", "arviz-stats")):
            if importlib.util.find_spec(module) is None:
                raise ImportError(f"`posterior` needs {name}: pip install 'jaxcontact[posterior]'.")
        density = Density(fit.problem, known, not fit._absolute)
        mode = _mode_of(fit, density) if prior is None else _mode_with_prior(fit, density, prior)
        drawn = draw(density, mode, chains, warmup, draws, seed)
        return _result(fit, density, mode, drawn)


def _check(fit: FitData) -> None:
    require_converged(fit, "posterior")
    if fit.has_trials:
        raise ValueError(
            "Argument `fit` must have independent points for a posterior, but has `groups` of "
            "correlated ones, which would make it too narrow; its standard errors allow for them."
        )
    if fit._shared is not None:
        raise ValueError(
            "Argument `fit` must have independent points for a posterior, but its readings share "
            "errors of rounding, for which it would be too narrow; its standard errors allow for "
            "them."
        )
    if fit._absolute:
        return
    if fit.dof < 1:
        raise ValueError(
            "Argument `sigma` of `fit` must be given for a posterior without degrees of freedom, "
            "which leave the size of the noise unknown."
        )
    data = np.linalg.norm((fit.data * fit._factor)[fit._used])
    if np.linalg.norm(fit.z) <= ROUNDING * data:
        raise ValueError(
            "Argument `sigma` of `fit` must be given for a posterior of an exact fit, which "
            "leaves the noise unknown."
        )


def _start(fit: FitData, density: Density) -> np.ndarray:
    """Return the best parameters, and the most probable noise there."""
    if not density.free:
        return fit._theta
    pull = np.clip(fit.z, -float(fit.problem.limit), float(fit.problem.limit))
    return np.append(fit._theta, np.log(np.mean(pull * fit.z)) / 2)


def _mode_of(fit: FitData, density: Density) -> Mode:
    """Return the mode with a flat prior: the end of the fit, and its Jacobian."""
    centre = _start(fit, density)
    k = len(fit._theta)
    scale = np.exp(centre[k]) if density.free else 1.0
    inside = fit._jacobian[fit._used][np.abs(fit.z) <= float(fit.problem.limit) * scale] / scale
    information = np.zeros((len(centre),) * 2)
    information[:k, :k] = inside.T @ inside
    if density.free:
        information[k, k] = 2 * fit._used.sum()
    return Mode(centre, root_of(information), np.zeros((k, k)))


def _mode_with_prior(fit: FitData, density: Density, prior: Any) -> Mode:
    start, space, given = _start(fit, density).copy(), fit.problem.space, density.prior
    for i in (i for i, name in enumerate(fit.names) if name in fit.at_bound and given.given[i]):
        # From its bound a parameter begins at the mean of its prior, moved inside.
        low, high = float(space.low[i]), float(space.high[i])
        inside = min(float(given.width[i]), (high - low) / 4)
        mean = float(np.clip(given.mean[i], low + inside, high - inside))
        start[i] = space.coordinates[i]._to_free(mean, low, high)
    mode = find_mode(density, start)
    _refuse_open(fit, mode.prior, prior)
    return mode


def _refuse_open(fit: FitData, curvature: np.ndarray, prior: Any) -> None:
    """Raise ValueError if neither data nor the curvature of a prior determine a direction."""
    names, labels = fit.names, dict(zip(fit.names, fit.problem.space.labels, strict=True))
    open_ = [Direction({name: 1.0}, labels) for name in fit.at_bound] + list(fit.unidentified)
    if not open_:
        return
    basis = np.array([[one.components.get(name, 0.0) for one in open_] for name in names])
    # Scale each direction by the prior; length 0 means that the prior does not constrain it.
    curvature = np.where(np.isfinite(curvature), curvature, 0)
    length = np.sqrt(np.abs(np.diag(curvature)) @ basis**2)
    basis /= np.where(length > 0, length, np.linalg.norm(basis, axis=0))
    values, vectors = np.linalg.eigh(basis.T @ curvature @ basis)
    if values[0] > SINGULAR:
        return
    change = basis @ vectors[:, 0]
    change /= change[np.argmax(np.abs(change))]
    parts = {name: float(x) for name, x in zip(names, change, strict=True) if abs(x) > _SHOWN}
    bound = next(filter(fit.at_bound.__contains__, parts), None)
    what = f"{bound} (at its bound)" if bound else f"a change of {Direction(parts, labels)}"
    raise ValueError(
        f"Argument `prior` must determine {what}, since the data do not: give mean and standard "
        f"deviation of {' or '.join(parts)}. It is {rendered(prior)}."
    )


def _result(fit: FitData, density: Density, mode: Mode, drawn: Draws) -> Posterior:
    k = len(fit.names)
    samples = {name: drawn.values[..., i] for i, name in enumerate(fit.names)}
    if density.free:
        name = "noise"
        while name in samples:
            name += "_"
        samples[name] = np.exp(drawn.phi[..., k])
    checked = {name: r_hat_and_effective(x) for name, x in samples.items()}
    ratio, count = ({name: pair[i] for name, pair in checked.items()} for i in (0, 1))
    faults = _faults(ratio, count, drawn, _open_bounds(density, mode, drawn))
    fine = f"R-hat up to {_ratio(max(ratio.values()))}, {min(count.values()):.0f} effective samples"
    reason, counts = "; ".join(faults) or fine, (drawn.divergences, drawn.evaluations)
    return Posterior(samples, ratio, count, *counts, not faults, reason, fit)


def _faults(
    ratio: dict[str, float], count: dict[str, float], drawn: Draws, lost: list[str]
) -> list[str]:
    """Return why the draws do not stand for the distribution, in words."""
    mixed = [name for name in ratio if not ratio[name] < LARGEST_R_HAT]
    few = [name for name in count if not count[name] >= FEWEST_EFFECTIVE]
    faults = []
    if lost:
        faults.append(f"the data do not exclude the bound of {first_few(lost)}: give a `prior`")
    if mixed:
        worst = float(np.max(list(map(ratio.__getitem__, mixed))))
        faults.append(f"chains differ in {first_few(mixed)}, R-hat up to {_ratio(worst)}")
    if drawn.divergences:
        faults.append(f"{drawn.divergences} of {drawn.phi[..., 0].size} draws diverged")
    if few:
        least = float(np.min(list(map(count.__getitem__, few))))
        faults.append(f"{least:.0f} effective samples of {first_few(few)}, of {FEWEST_EFFECTIVE}")
    return faults


def _open_bounds(density: Density, mode: Mode, drawn: Draws) -> list[str]:
    """Return the coordinates whose flat prior extends where the data do not exclude it.

    Towards a bound the density of a logarithm or logit becomes constant. The test is whether one
    unit there holds more than a draw, with the other parameters at their best: chains reach it, or
    would have by chance.
    """
    prior, space = density.prior, density.problem.space
    places = np.flatnonzero(space.has_unit & ~np.asarray(prior.given))
    if prior.density is not None or not len(places):
        return []
    draws = drawn.phi.reshape(-1, drawn.phi.shape[-1])
    least = find_mode(density, mode.centre).value - np.log(len(draws))
    found = []
    for i in places:
        far = np.abs(draws[:, i] - mode.centre[i]).max() > FAR
        for side in (-1, 1) if space.bounded_above[i] else (-1,):
            start = mode.centre.copy()
            start[i] += side * FAR
            far |= find_mode(density, start, int(i)).value > least
        if far:
            found.append(space.labels[i])
    return found


def _places(value: float, width: float) -> int:
    """Return the significant digits of a number with this width."""
    with np.errstate(divide="ignore", invalid="ignore"):
        known = np.log10(np.abs(value) / width)
    return int(np.clip(np.ceil(known) + 2, _PLACES, 15)) if np.isfinite(known) else _PLACES


def _ratio(x: float) -> str:
    return f"{x:.3f}" if x < 10 else f"{x:.1g}"

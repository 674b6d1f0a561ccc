"""`fit`: check the arguments, search, and assess the end of the search; and its result."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import inspect
from collections.abc import Callable, Iterator
from typing import Any, TypedDict, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from .._entry import (
    POSITIVE,
    as_flag,
    refusal,
    refuses_unknown,
    require_choice,
    require_count,
    require_flag,
    require_function,
    require_number,
)
from .._program import in_double
from .._text.failure import checked
from .._text.progress import progress_of
from .._text.words import first_few
from .data import FitData
from .problem.problem import FitProblem, Huber, as_place, shapes_of
from .problem.space import Space, space_of
from .problem.target import groups_of, target_of, whitener_of
from .search.minimum import (
    FARTHEST,
    MOST_STEPS,
    PATIENCE,
    SearchEnd,
    SearchOptions,
    find,
    find_all,
    in_numpy,
    start_scale,
    with_step,
)
from .search.noise import BY_COLUMN, COMMON, ColumnErrors, refit, refuse_between
from .search.verdict import at_bound_of, creeping, falling, infer, refuse_unused, verdict
from .uncertainty.adequacy import Adequacy, adequacy_of
from .uncertainty.bootstrap import bootstrap
from .uncertainty.interval import confidence_band, interval, prediction_band, profile

_MOST_GRADIENT_STEPS = 10_000
LEVENBERG_MARQUARDT = "levenberg-marquardt"


@dataclasses.dataclass(frozen=True, repr=False)
class Fit(FitData):
    __doc__ = FitData.__doc__

    bootstrap = bootstrap
    confidence_band = confidence_band
    interval = interval
    prediction_band = prediction_band
    profile = profile

    @functools.cached_property
    def adequacy(self) -> Adequacy:
        """The tests whether the model describes the data, computed on first use."""
        return adequacy_of(self)

    @property
    def adequate(self) -> bool | None:
        """True if the model describes the data; None if undecided."""
        return self.adequacy.adequate

    def summary(self) -> str:
        """Return the fit in words, with a line for each parameter."""
        good = "converged" if self.converged else "NOT CONVERGED"
        points = np.count_nonzero(self.problem.factor)
        lines = [
            f"Fit: {good} in {self.steps} steps, {self.reason}",
            f"  loss {self.loss:.6g}, {points} points, {self.dof} degrees of freedom",
        ]
        if self.converged:
            verdict = str(self.adequacy)
            first = self.adequate is False
            lines.insert(
                0 if first else 2, verdict[0].upper() + verdict[1:] if first else f"  {verdict}"
            )
        width = max(map(len, self.names))
        lines += [
            f"  {name:{width}}  {f'{value:.9g} {unit}'.rstrip()}{self._certainty(name)}"
            for name, value, unit in zip(
                self.names, self.values, self.problem.space.units, strict=True
            )
        ]
        lines += [f"  not identifiable: a change of {d}" for d in self.unidentified]
        lines += [f"  {note}" for note in self.notes]
        return "\n".join(lines)

    def _certainty(self, name: str) -> str:
        if not self.converged:
            return ""
        if name in self.at_bound:
            return "  at its bound"
        error = self.standard_errors[name]
        if not np.isnan(error):
            return f"  ± {error:.2g}" + (", were the model right" if self.adequate is False else "")
        return f"  {self.why_no_error(name)}"

    __repr__ = summary


def fit(
    predict: Callable[..., Any],
    data: Any,
    start: Any,
    *,
    x: Any = None,
    sigma: Any = None,
    weights: Any = None,
    groups: ArrayLike | None = None,
    correlation: ArrayLike | None = None,
    transforms: Any = None,
    loss: str | Huber = "squares",
    noise: str = COMMON,
    optimizer: Any = LEVENBERG_MARQUARDT,
    starts: int = 1,
    spread: float = 1.0,
    seed: int = 0,
    max_steps: int | None = None,
    patience: int = PATIENCE,
    rtol: float = 1e-8,
    reverse: bool = False,
    progress: bool | Callable[[int, float], None] | None = None,
    throw: bool = True,
) -> Fit:
    """Fit the parameters of a prediction to data, by least squares or Huber's loss.

    Minimises ½ Σ ((predict(params) - data)/σ)² over the floating-point numbers in the pytree
    `start` (a law, a contact, a dict of them). Whole arrays are fitted; integers and strings stay.

    Arguments: `predict(params)`, or `predict(params, x)` if `x` is given, differentiable by JAX,
    with the structure of `data`, any tree of numbers. `sigma`, standard deviations of the data (one
    number, or a tree like the data), or `weights`, relative ones of squares (1 if neither is
    given). A weight of 0 leaves a point out, whatever its value. With `sigma` standard errors are
    absolute, otherwise they are scaled by the residuals.

    `groups` (points,): the name of the trial of each point, if points of one trial are correlated.
    With at least 8 trials standard errors are the sandwich over trials, which such a correlation
    does not bias. `correlation` (points, points): the known correlation of the errors of the
    points, 1 on its diagonal. Residuals are then whitened before they are squared.

    `transforms`: `Free()`, `Positive()`, `Between(low, high)` or `Fixed()`, for all numbers; or a
    dict of them by name ("contact.mass", or "contact" for all in it); or a prefix of the tree of
    `start`, with None for the default. By default a number keeps to the range declared by its law
    or contact, and is free otherwise.

    `loss`: "squares" or `Huber(threshold)`, which bounds the influence of outliers. Without `sigma`
    its scale is the median of |residuals|, iterated with the fit. `noise`: "common", one size for
    all points, times the weights; or "by column", one for each leaf of the tree of `data`, iterated
    with the fit. Use "by column" for readings of several instruments with independent errors.

    `optimizer`: "levenberg-marquardt" or an optax optimiser, which stops after `patience` steps
    without gain. `starts`: the number of starts, the given one and normal ones around it, drawn
    from `seed`; the lowest loss is kept. Their standard deviation is `spread` in a logarithm or
    logit, and `spread` times a number without bounds (from zero: times the change that moves the
    prediction by the size of the data). `max_steps`: by default 500, 10000 for optax. `reverse`:
    compute the Jacobian in reverse mode, for predictions without a forward mode. `progress`: True
    shows step and loss on stderr, a function is called with them. None, like False, shows nothing.

    `converged` does not depend on the optimizer. The remaining Gauss-Newton step must be below
    `rtol` of each parameter (of its logarithm, of its logit). If the search ended by itself, a step
    below a thousandth of the standard error suffices. Computes in double precision regardless of
    the JAX setting, and does not work under `jit`. The same `predict` (and optax optimiser) over
    data of the same shapes does not compile again; a new lambda is another function and does.

    Returns a `Fit`. One that did not converge raises `NumericalError` unless `throw` is False; a
    number at its bound or left open is no failure. Raises ValueError for data that are not finite
    where they count; for fewer data than named numbers to fit; for a start outside its bounds, with
    no finite prediction or with a number that is not used; and for arguments that do not match.

    Source: Levenberg (1944), doi 10.1090/qam/10666; Marquardt (1963), doi 10.1137/0111030; in a
    trust region: Moré (1978), doi 10.1007/BFb0067700.
    """
    require_function("predict", predict)
    huber, by_gradient = threshold_of(loss), _optax_or_none(optimizer)
    if require_choice("noise", noise, (COMMON, BY_COLUMN)) == BY_COLUMN and sigma is not None:
        raise ValueError("Argument `noise` must be 'common' with `sigma`, but is 'by column'.")
    starts, seed = require_count("starts", starts, 1), require_count("seed", seed, 0)
    spread = require_number("spread", spread, POSITIVE)
    rtol = require_number("rtol", rtol, POSITIVE)
    patience = require_count("patience", patience, 1)
    reverse, throw = require_flag("reverse", reverse), require_flag("throw", throw)
    most = MOST_STEPS if by_gradient is None else _MOST_GRADIENT_STEPS
    most = most if max_steps is None else require_count("max_steps", max_steps, 1)
    with _listener_of(progress, most) as tell, in_double():
        y, factor = target_of(data, sigma, weights)
        names = groups_of(groups, y.size)
        whitener = whitener_of(correlation, factor > 0)
        space, theta = space_of(start, transforms)
        _refuse_too_many(space, int((factor > 0).sum()))
        problem = FitProblem(
            predict,
            space,
            jax.tree.map(as_place, x),
            jax.device_put(y),
            jax.device_put(factor),
            huber if huber is None else jnp.asarray(huber),
            reverse,
            shapes_of(data),
            whitener if whitener is None else jax.device_put(whitener),
        )
        columns = problem.columns * (noise == BY_COLUMN)
        refuse_between(columns, whitener)
        options = SearchOptions(jnp.asarray(rtol), by_gradient, most, patience, tell)
        away = np.random.default_rng(seed).normal(size=(starts - 1, len(theta))) * spread
        rough, ends = _first_guess(problem, theta, options, away)
        found = find(problem, rough, options)
        _check_start(problem, theta, found)
        refuse_unused(problem, found)
        found = set_to_bound(problem, found, theta, options)
        settled = True
        if sigma is None and (huber is not None or noise == BY_COLUMN):
            errors = ColumnErrors(problem, columns)
            found = refit(errors, found, lambda last, new: find(new, last.theta, options))
            problem, settled = errors.problem, errors.settled
        result = result_of(problem, found, theta, sigma is not None, ends, names, options, settled)
    return checked(result, throw, "fit")


def _first_guess(
    problem: FitProblem, theta: np.ndarray, options: SearchOptions, away: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return where the search starts, the best end of many starts, and losses at their ends."""
    if not len(away):
        return theta, np.zeros(0)
    lanes = np.stack([theta, *(theta + away * start_scale(problem, theta))])
    found = find_all(problem, lanes, options._replace(tell=None))
    ends = np.where(np.isfinite(found.loss), found.loss, np.inf)
    best = int(np.argmin(ends))
    return found.theta[best] if np.isfinite(ends[best]) else lanes[0], ends


def _optax_or_none(optimizer: Any) -> Any:
    if isinstance(optimizer, str) and optimizer == LEVENBERG_MARQUARDT:
        return None
    # A class has the functions of its objects, but is not an optimiser.
    parts = () if isinstance(optimizer, type) else ("init", "update")
    if not parts or not all(callable(getattr(optimizer, part, None)) for part in parts):
        raise refusal("optimizer", f"be {LEVENBERG_MARQUARDT!r} or an optax optimiser", optimizer)
    return optimizer


def threshold_of(loss: Any) -> float | None:
    """Return Huber's threshold; None for squares. Raises ValueError for a loss of another kind."""
    if isinstance(loss, Huber):
        return float(loss.threshold)
    if not isinstance(loss, str) or loss != "squares":
        raise refusal("loss", "be 'squares' or a `Huber`", loss)
    return None


def _refuse_too_many(space: Space, points: int) -> None:
    """Raise ValueError if there are more named numbers to fit than points with weight.

    This is not a mistake for the weights in an array, as in a network.
    """
    if len(space.names) > points and not any(space.shapes):
        raise ValueError(
            f"Argument `data` must hold at least as many points that count as `start` has numbers "
            f"to fit ({len(space.names)}: {first_few(space.names)}), but holds {points}. Add "
            "points, or keep numbers with `transforms={name: jc.Fixed()}`."
        )


def _check_start(problem: FitProblem, theta: np.ndarray, found: SearchEnd) -> None:
    """Raise ValueError if the prediction is not finite at the start."""
    if np.isfinite(found.history[0]):
        return
    prediction = np.asarray(problem.prediction(jnp.asarray(theta)))
    bad = ~np.isfinite(prediction) & (np.asarray(problem.factor) > 0)
    if bad.any():
        points = first_few([str(i) for i in np.flatnonzero(bad)])
        raise ValueError(
            f"Argument `start` must have a finite prediction, but has none at the points {points}."
        )


def set_to_bound(
    problem: FitProblem, found: SearchEnd, start: np.ndarray, options: SearchOptions
) -> SearchEnd:
    """Set a parameter that creeps to a bound there, if that is no worse."""
    space = problem.space
    out = creeping(space, found.step)
    if not out.any() or not np.isfinite(found.loss):
        return found
    bound = np.where(space.bounded_above, np.sign(found.step) * FARTHEST, start - FARTHEST)
    there = find(problem, np.where(out, bound, found.theta), options)
    return there if there.loss <= found.loss else found


def result_of(
    problem: FitProblem,
    found: SearchEnd,
    start: np.ndarray,
    absolute: bool,
    ends: np.ndarray,
    groups: np.ndarray | None,
    options: SearchOptions,
    settled: bool,
) -> Fit:
    """Return the end of a search as a fit: its verdict and its standard errors."""
    space, y, used = problem.space, np.asarray(problem.y), np.asarray(problem.factor) > 0
    at_bound = at_bound_of(space, found, start, used)
    if at_bound.any():
        free = np.where(at_bound, 0, found.jacobian)
        found = with_step(in_numpy(problem), found, free, np.asarray(options.rtol), np)
    converged, reason = verdict(found, at_bound, space, options.max_steps)
    if converged and not settled:
        converged, reason = False, "the noise of the data did not settle"
    inference = infer(problem, found, at_bound, absolute, groups)
    falls = falling(problem, found, start, inference["unidentified"]) if converged else None
    if falls is not None:
        converged = False
        reason = f"a saddle or a maximum: the loss falls along {falls}; start elsewhere"
    if not converged:
        unknown = np.full_like(inference["covariance"], np.nan)
        inference |= {"covariance": unknown, "unidentified": ()}
    with np.errstate(divide="ignore", invalid="ignore"):
        residuals = np.where(used, found.prediction - y, np.nan)
    steps = int(found.steps)
    return Fit(
        params=space.tree_of(found.values),
        names=space.names,
        values=found.values,
        loss=float(found.loss),
        history=found.history[:steps],
        residuals=residuals,
        converged=converged,
        reason=reason,
        steps=steps,
        **inference,
        starts=ends,
        data=np.where(used, y, np.nan),
        groups=groups,
        problem=problem,
        _theta=found.theta,
        _jacobian=np.where(at_bound | ~np.isfinite(found.jacobian), 0, found.jacobian),
        _absolute=absolute,
        _rtol=float(options.rtol),
    )


@contextlib.contextmanager
def _listener_of(progress: Any, most: int) -> Iterator[Callable[[Any, Any], Any] | None]:
    """Yield the function to call with each step and its loss; None without progress."""
    # Reports from inside a search compile another program: None asks for none.
    if progress is None or as_flag(progress) is False:
        yield None
    elif callable(progress):
        yield lambda step, loss: progress(int(step), float(loss))
    else:
        with progress_of(progress, "steps", "fit") as bar:
            yield lambda step, loss: bar(int(step), most, f"loss {float(loss):.6g}")


Function = TypeVar("Function", bound=Callable[..., Any])


class SearchKeywords(TypedDict, total=False):
    """Those of the loss and of the search."""

    loss: str | Huber
    noise: str
    optimizer: Any
    starts: int
    spread: float
    seed: int
    max_steps: int | None
    patience: int
    rtol: float
    reverse: bool


class ColumnKeywords(SearchKeywords, total=False):
    """Those of a fit whose columns have their own standard deviations."""

    weights: Any
    groups: Any
    correlation: Any
    transforms: Any
    progress: bool | Callable[[int, float], None] | None
    throw: bool


class FitKeywords(ColumnKeywords, total=False):
    """All but x."""

    sigma: Any


def takes(keywords: type, **defaults: Any) -> Callable[[Function], Function]:
    """Show `keywords` of `fit` in a signature, for its last argument, and refuse unknown ones."""
    passed = inspect.signature(fit).parameters
    added = [passed[name] for name in keywords.__annotations__]
    added = [one.replace(default=defaults.get(one.name, one.default)) for one in added]

    def shown(function: Any) -> Any:
        signature = inspect.signature(function)
        *own, _ = signature.parameters.values()

        @functools.wraps(function)
        def flagging(*given: Any, throw: bool = True, **how: Any) -> Any:
            throw = require_flag("throw", throw)
            return checked(function(*given, **how, throw=False), throw, function.__name__)

        passes_on: Any = flagging if "throw" in keywords.__annotations__ else function
        passes_on.__signature__ = signature.replace(parameters=[*own, *added])
        return refuses_unknown(passes_on)

    return shown

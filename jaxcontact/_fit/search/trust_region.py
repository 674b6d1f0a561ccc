"""Levenberg-Marquardt within a trust region, with a correction for curved residuals."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..problem.problem import FitProblem, Point, shortened, shortened_slope

_TOLERANCE = 1e-13
"""Step relative to its coordinate, and relative fall of the loss, at convergence."""

_EPS = float(jnp.finfo(jnp.float64).eps)

_CUT = 1e-14
"""Relative singular value that is rounding."""

_LEAST, _POOR, _GOOD = 1e-4, 0.25, 0.75
"""Limits of the ratio of the actual to the predicted fall of the loss.

Below the first a step is refused, below the second the next ones are shorter, and above the third
they are longer.
"""

_BENT = 0.375
"""Longest accepted correction relative to its step."""

_LINEAR = 1e-3
"""Deviation from the predicted fall below which the next step may be ten times as long."""

_REFUSED = 16
"""Refused steps in a row after which the search ends; each is a quarter of the last."""

_NARROWINGS = 12
"""Iterations of the damping for a step within 10 % of the radius; three usually suffice."""


class Here(NamedTuple):
    """The best point θ of a search, its residuals r, and dr/dθ with non-finite numbers as 0.

    `scale` (k,) makes steps of different units comparable: the greatest length that each column of
    dr/dθ has had.
    """

    theta: Float[Array, " k"]
    point: Point
    r: Float[Array, " n"]
    slope: Float[Array, "n k"]
    scale: Float[Array, " k"]

    @property
    def squares(self) -> Float[Array, ""]:
        """The sum of squares, twice the loss."""
        return jnp.sum(jnp.square(self.r))


class _ProposedStep(NamedTuple):
    """A point θ to evaluate, and the step to it, apart from a correction.

    `length` is that of the scaled step. `promise` is the fall of the sum of squares predicted by
    the linear model, which counts the damping twice.
    """

    theta: Float[Array, " k"]
    step: Float[Array, " k"]
    length: Float[Array, ""]
    damping: Float[Array, ""]
    promise: Float[Array, ""]
    corrected: Bool[Array, ""]


# Shapes are computed before the search: a compiled function is traced once for both.
_point = eqx.filter_jit(FitProblem.at)


class Search(NamedTuple):
    """A search between two steps: its best point, the next trial, and the loss after each step.

    `radius` bounds the next step, `last` is the promise of the last accepted one, and `refused`
    counts refused steps in a row. `ended`: the search ended by itself.
    """

    here: Here
    trial: _ProposedStep
    radius: Float[Array, ""]
    last: Float[Array, ""]
    refused: Int[Array, ""]
    history: Float[Array, " steps"]
    step: Int[Array, ""]
    ended: Bool[Array, ""]


def begin(problem: FitProblem, start: Float[Array, " k"], max_steps: int) -> Search:
    """Return a search of at most `max_steps` steps before its first one."""
    # The start is evaluated in the loop, so that the prediction is compiled once.
    zero, none, no = jnp.zeros(()), jnp.zeros_like(start), jnp.asarray(False)
    count, history = jnp.zeros((), int), jnp.full(max_steps, jnp.nan, start.dtype)
    shapes = jax.eval_shape(functools.partial(_point, problem), start)
    point = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)
    here = Here(start, point, point.z, point.jacobian, none)
    trial = _ProposedStep(start, none, zero, zero, zero, no)
    return Search(here, trial, zero, jnp.asarray(jnp.inf), count, history, count, no)


def least_squares(
    problem: FitProblem,
    search: Search,
    limit: int | Int[Array, ""],
    report: Callable[[Array, Array], None],
) -> Search:
    """Continue a search until it ends or has made `limit` steps.

    The step p minimises |r + J p| with |D p| ≤ radius, D the greatest lengths of the columns of J.
    If it is refused, the residuals give their curvature along it. The next trial is the parabola p
    + a/2, with (JᵀJ + λD²) a = -2 Jᵀ(r(θ + p) - r - J p). It follows narrow curved valleys.

    Source: Moré (1978), doi 10.1007/BFb0067700; Transtrum and Sethna (2012), doi
    10.48550/arXiv.1201.5885.
    """

    def unfinished(search: Search) -> Array:
        return ~search.ended & (search.step < limit)

    def advance(search: Search) -> Search:
        here, trial, radius, last, refused, history, step, _ = search
        first = step == 0
        there = here_at(problem, trial.theta, here.scale)
        fall = here.squares - there.squares
        gain = jnp.where(jnp.isfinite(fall), fall / _positive(trial.promise), -1)
        # If rounding hides the fall, Gauss-Newton steps are accepted while they get shorter.
        blur = _blur(problem, here)
        level = 4 * (jnp.sqrt(here.squares) + blur) * (_EPS * jnp.sqrt(here.squares) + blur)
        hidden = trial.promise <= level
        nearer = hidden & (jnp.abs(fall) <= level) & (trial.promise < last / 2)
        accepted = first | (gain > _LEAST) | nearer
        still = jnp.all(jnp.abs(trial.theta - here.theta) <= _TOLERANCE * _sizes(problem, here))
        done = jnp.where(accepted, still & (fall <= _TOLERANCE * here.squares), hidden)
        refused = jnp.where(accepted, 0, refused + ~trial.corrected)
        last = jnp.where(accepted & ~first, trial.promise, last)
        radius = jnp.where(trial.corrected, trial.length, radius)
        less = jnp.where(gain < 0, 0.25, 0.5) * jnp.minimum(radius, 10 * trial.length)
        more = jnp.where(jnp.abs(gain - 1) < _LINEAR, 10, 2) * trial.length
        radius = jnp.where(gain > _GOOD, more, jnp.where(gain < _POOR, less, radius))
        again = ~(accepted | trial.corrected | hidden) & jnp.isfinite(fall)
        bend = jnp.where(again, there.r - here.r - here.slope @ trial.step, 0)
        begun, wide = _initial(problem, there)
        there, radius = _where(first, (begun, wide), (there, radius))
        here = _where(accepted, there, here)
        trial = _next(here, trial, radius, bend, again)
        loss = here.squares / 2
        report(step, loss)
        ended = (done & ~first) | (refused >= _REFUSED) | ~jnp.isfinite(loss)
        ended |= trial.promise <= jnp.square(_blur(problem, here))
        history = history.at[step].set(loss)
        return Search(here, trial, radius, last, refused, history, step + 1, ended)

    return jax.lax.while_loop(unfinished, advance, search)


def here_at(problem: FitProblem, theta: Float[Array, " k"], scale: Float[Array, " k"]) -> Here:
    point = _point(problem, theta)
    slope = shortened_slope(point.z, point.jacobian, problem.threshold)
    longest = jnp.maximum(scale, jnp.linalg.norm(slope, axis=0))
    return Here(theta, point, shortened(point.z, problem.threshold), slope, longest)


def _initial(problem: FitProblem, here: Here) -> tuple[Here, Float[Array, ""]]:
    """Return the start of a search, and a first radius: each coordinate may change by its size.

    A logarithm or logit with little effect at the start must not run away. A change by 1 therefore
    counts at least as much as the size of the data.
    """
    unit = jnp.where(problem.space.has_unit, _unit(problem, here.point), 0)
    scale = jnp.maximum(here.scale, unit)
    natural = scale_of(problem, here)
    size = jnp.where(here.theta == 0, natural, _sizes(problem, here))
    return here._replace(scale=scale), jnp.linalg.norm(scale * size)


def _sizes(problem: FitProblem, here: Here) -> Float[Array, " k"]:
    return jnp.where(problem.space.has_unit, 1, jnp.abs(here.theta))


def scale_of(problem: FitProblem, here: Here) -> Float[Array, " k"]:
    """Return the change of each coordinate that moves the prediction by the size of the data."""
    length = jnp.linalg.norm(here.slope, axis=0)
    change = jnp.where(length > 0, _unit(problem, here.point) / _positive(length), 1)
    return jnp.where(problem.space.has_unit, 1, change)


def _unit(problem: FitProblem, point: Point) -> Float[Array, ""]:
    data = _size(problem, problem.y * problem.factor)
    return _positive(jnp.where(data > 0, data, _size(problem, point.z)))


def _blur(problem: FitProblem, here: Here) -> Float[Array, ""]:
    """Return the rounding of all residuals together."""
    terms = jnp.abs(problem.y) + jnp.abs(here.point.prediction)
    return _EPS * _size(problem, problem.factor * terms)


def _size(problem: FitProblem, values: Float[Array, " n"]) -> Float[Array, ""]:
    return jnp.linalg.norm(jnp.where(problem.factor > 0, values, 0))


def _where(which: Bool[Array, ""], chosen: Any, other: Any) -> Any:
    return jax.tree.map(functools.partial(jnp.where, which), chosen, other)


def _positive(x: Array) -> Array:
    return jnp.where(x > 0, x, 1)


def _next(
    here: Here, trial: _ProposedStep, radius: Array, bend: Float[Array, " n"], may: Bool[Array, ""]
) -> _ProposedStep:
    """Return the step from `here` within the radius, or the correction of the last one.

    The correction is used if it `may` be and is short. It follows from `bend`, the deviation of the
    last end from the linear model.
    """
    scale = _positive(here.scale)
    u, s, vt = jnp.linalg.svd(here.slope / scale[None, :], full_matrices=False)
    kept = s > _CUT * s[0]
    s = jnp.where(kept, s, 0)

    def solution(r: Float[Array, " n"], damping: Float[Array, ""]) -> Float[Array, " k"]:
        return -vt.T @ (s * (u.T @ r) / jnp.where(kept, s * s + damping, 1))

    aside = solution(bend, trial.damping)
    may &= jnp.linalg.norm(aside) <= _BENT * trial.length
    damping = _damping(s, s * (u.T @ here.r), radius)
    ahead = solution(here.r, damping)
    length = jnp.linalg.norm(ahead)
    promise = jnp.sum(jnp.square(s * (vt @ ahead))) + 2 * damping * jnp.square(length)
    step = ahead / scale
    usual = _ProposedStep(here.theta + step, step, length, damping, promise, jnp.asarray(False))
    bent = trial._replace(theta=here.theta + trial.step + aside / scale, corrected=may)
    return _where(may, bent, usual)


def _damping(s: Float[Array, " m"], slope: Float[Array, " m"], radius: Array) -> Float[Array, ""]:
    """Return λ for which the step -slope/(s² + λ) is as long as the radius; 0 if it is shorter."""

    def length(damping: Array) -> Array:
        return jnp.linalg.norm(slope / _positive(s * s + damping))

    def narrowed(_: Any, known: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        low, high, damping = known
        now = length(damping)
        low, high = jnp.where(now > radius, damping, low), jnp.where(now > radius, high, damping)
        # Newton's step for 1/length, which is nearly linear.
        turn = jnp.sum(jnp.square(slope) / _positive(s * s + damping) ** 3)
        better = damping + jnp.square(now) / _positive(turn) * (now / _positive(radius) - 1)
        inside = (low < better) & (better < high)
        better = jnp.where(inside, better, jnp.maximum(jnp.sqrt(low * high), 1e-3 * high))
        return low, high, jnp.where(jnp.abs(now - radius) < 0.1 * radius, damping, better)

    none = jnp.zeros_like(radius)
    high = jnp.linalg.norm(slope) / _positive(radius)
    *_, damping = jax.lax.fori_loop(0, _NARROWINGS, narrowed, (none, high, 1e-3 * high))
    return jnp.where(length(none) <= 1.1 * radius, 0, damping)

"""`fit_many`: check the tables, search for all balls at once, and assess the ends."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Bool, Float, Int

from ..._entry import (
    POSITIVE,
    refusal,
    require_count,
    require_flag,
    require_function,
    require_number,
)
from ..._program import in_double
from ..._text.failure import Flagged, WordedEnum
from ..._text.progress import progress_of
from ..._text.words import text_table
from ..fit import Fit, result_of, set_to_bound, threshold_of
from ..problem.problem import FitProblem, Huber
from ..search.minimum import MOST_STEPS, SearchEnd, SearchOptions, decomposed
from ..search.verdict import creeping, near_bound, noise_of, refuse_unused
from .search import Balls, block_sizes, rows_of, search_all
from .tables import Tables, starts_of, tables_of

_NAMED = 5
"""Largest number of failed balls that are listed."""


class FitStatus(WordedEnum):
    """The outcome for one ball of `fit_many`; from NOT_CONVERGED on they are failures, with NaN."""

    CONVERGED = 0, "Every parameter has a standard error."
    AT_BOUND = 1, "A parameter ran to its bound, and has no standard error."
    NOT_IDENTIFIABLE = 2, "A parameter has no standard error: the data do not determine it."
    NOT_CONVERGED = 3, "The search did not converge. Try another start, or more `max_steps`."
    NO_PREDICTION = 4, "The prediction, or its loss, is not finite at the start."
    TOO_FEW_POINTS = 5, "There are more numbers to fit than points that count."
    INVALID_INPUT = 6, "Data are not finite, or `sigma`, weights or the start are out of range."


@dataclasses.dataclass(frozen=True, repr=False)
class Fits(Flagged):
    """The fits of many balls, in the order of `balls`, their names.

    `params` has the structure of the start; each fitted number has a first axis of the balls.
    `names` and `values` (balls, k) list the numbers, and `covariance` (balls, k, k) and
    `standard_errors`, by name (balls,), are as those of a `Fit`. `loss`, `dof`, `noise` and `steps`
    are (balls,). `status` (balls,), see `FitStatus`, with `reasons` in words. A failed ball, where
    `ok` is False, has NaN and leaves the others as they are.
    """

    balls: np.ndarray
    params: Any
    names: tuple[str, ...]
    values: Float[np.ndarray, "balls k"]
    covariance: Float[np.ndarray, "balls k k"]
    loss: Float[np.ndarray, " balls"]
    dof: Int[np.ndarray, " balls"]
    noise: Float[np.ndarray, " balls"]
    steps: Int[np.ndarray, " balls"]
    status: Int[np.ndarray, " balls"]
    reasons: tuple[str, ...]
    _units: tuple[str, ...]
    _single: Callable[[int], Fit]

    _failures = tuple(s for s in FitStatus if s >= FitStatus.NOT_CONVERGED)

    @property
    def standard_errors(self) -> dict[str, Float[np.ndarray, " balls"]]:
        """The standard errors of each parameter; NaN where it has none."""
        errors = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        return dict(zip(self.names, errors.T, strict=True))

    def fit(self, ball: Any) -> Fit:
        """Return the whole `Fit` of a ball, as `jc.fit` does, by its name.

        Raises ValueError for an unknown name, and for a ball without a fit.
        """
        places = np.flatnonzero(self.balls == ball)
        if len(places) != 1:
            raise refusal("ball", f"be one of `balls`, such as {self.balls.tolist()[0]!r}", ball)
        i = int(places[0])
        if self.status[i] > FitStatus.NOT_CONVERGED:
            raise ValueError(f"Argument `ball` must have a fit, but {ball!r}: {self.reasons[i]}.")
        return self._single(i)

    def summary(self) -> str:
        """Return the number of balls of each status, and the spread of each parameter."""
        ok = np.asarray(self.ok)
        lines = [f"Fits of {len(ok):,} balls: {FitStatus.names_of(self.status)}"]
        rows = []
        for name, unit, column in zip(self.names, self._units, self.values.T, strict=True):
            good, errors = column[ok], self.standard_errors[name]
            errors = errors[np.isfinite(errors)]
            cells = [f"{x:.6g}" for x in np.quantile(good, [0.1, 0.5, 0.9])] if good.size else []
            error = [f"{np.median(errors):.2g}"] if errors.size else []
            rows.append([name, *(cells or ["-"] * 3), *(error or ["-"]), unit])
        head = ["", "10 %", "median", "90 %", "median ±", ""]
        lines += [line.rstrip() for line in text_table(rows, header=head, align="<>>>>", indent=2)]
        failed = np.flatnonzero(~ok)
        lines += [f"  ball {self.balls[i]}: {self.reasons[i]}" for i in failed[:_NAMED]]
        if len(failed) > _NAMED:
            lines.append(f"  and {len(failed) - _NAMED:,} more")
        return "\n".join(lines)

    __repr__ = summary


def fit_many(
    predict: Callable[..., Any],
    data: Any,
    start: Any,
    *,
    balls: ArrayLike | None = None,
    x: Any = None,
    sigma: Any = None,
    weights: Any = None,
    transforms: Any = None,
    own_start: bool = False,
    loss: str | Huber = "squares",
    max_steps: int | None = None,
    rtol: float = 1e-8,
    reverse: bool = False,
    batch_size: int | None = None,
    progress: bool | Callable[[int, int], None] | None = None,
) -> Fits:
    """Fit the same prediction to the tables of many balls at once, each with its own parameters.

    Each ball is fitted as by `fit(predict, data, start, x=x, sigma=sigma)`, with the same result up
    to rounding; one program advances many balls at a time.

    Arguments: `data`, `x` and `sigma` or `weights` as in `fit`, with a first axis of the balls:
    `data` (balls, points), or a tree of such arrays. One `sigma` for each ball has the shape
    (balls, 1), one for each place in all rows (1, points); an array with fewer axes is refused.
    Leave a point out by a weight of 0 or an infinite `sigma`. With `balls` (points,), the name of
    the ball of each point, they are columns (points,) of a long table instead. Balls may then
    differ in their number of points. The prediction at a point must depend on x of that point
    alone, because shorter tables repeat their last point with a weight of 0.

    `start` as in `fit`, for all balls. With `own_start` each ball has its own: arrays in `start`
    have a first axis of the balls, in the order in which `balls` first names them. That includes
    numbers that are not fitted, such as the mass of each ball. `transforms`, `max_steps`, `rtol`
    and `reverse` as in `fit`; `loss` too, but `Huber` needs `sigma`. `batch_size`: balls that one
    call advances. `progress`: as in `sweep`, counted in balls.

    Another number of balls does not compile again, nor do other values; another largest number of
    points does, and a new lambda.

    Returns `Fits`, with a status for each ball. A ball with numbers out of range, with too few
    points, or without convergence is flagged, and the others are as without it. Raises ValueError
    for columns that do not match, and for a number that no prediction uses.
    """
    require_function("predict", predict)
    huber = threshold_of(loss)
    if huber is not None and sigma is None:
        raise ValueError("Argument `sigma` must be given with a `Huber` loss, but is None.")
    own_start, reverse = require_flag("own_start", own_start), require_flag("reverse", reverse)
    rtol = require_number("rtol", rtol, POSITIVE)
    most = MOST_STEPS if max_steps is None else require_count("max_steps", max_steps, 1)
    most_at_once = None if batch_size is None else require_count("batch_size", batch_size, 1)
    with progress_of(progress, "balls", "fit_many") as tell, in_double():
        tables = tables_of(balls, data, x, sigma, weights)
        space, theta, others, valid = starts_of(start, transforms, own_start, len(tables.balls))
        threshold = jax.tree.map(jnp.asarray, huber)
        lanes = Balls(tables.x, tables.y, tables.factor, theta, others)
        first = jax.device_put(rows_of(lanes, 0))
        at, how = (first.x, first.y, first.factor), (threshold, reverse, tables.shapes)
        shared = FitProblem(predict, space, *at, *how)
        options = SearchOptions(jnp.asarray(rtol), max_steps=most)
        blocks = block_sizes(len(tables.balls), most_at_once)
        ends, histories = search_all(shared, lanes, options, blocks, tell)
        # A number is unused if its column of the Jacobian is zero for all balls.
        refuse_unused(shared, rows_of(ends, 0)._replace(jacobian=np.any(ends.jacobian, axis=0)))
        return _Made(shared, tables, lanes, options, ends, histories).fits(tables.valid & valid)


@dataclasses.dataclass(frozen=True)
class _Made:
    """The searches of all balls, and what they were made from."""

    shared: FitProblem
    tables: Tables
    lanes: Balls
    options: SearchOptions
    ends: SearchEnd
    histories: list[np.ndarray]

    def fits(self, valid: Bool[np.ndarray, " B"]) -> Fits:
        """Return the result: ends that are not plain are assessed one by one, as `fit` does."""
        ends, space = self.ends, self.shared.space
        plain, covariance, dof, noise = self.assessed()
        values, loss, steps = ends.values.copy(), ends.loss.copy(), ends.steps.copy()
        status = np.full(len(valid), int(FitStatus.CONVERGED), np.int8)
        reasons = ["no step is left"] * len(valid)
        few = (self.lanes.factor > 0).sum(axis=1) < len(space.names)
        few &= not any(space.shapes)
        blind = np.array([not np.isfinite(history[0]) for history in self.histories])
        for kind, which in (
            (FitStatus.NO_PREDICTION, blind),
            (FitStatus.TOO_FEW_POINTS, few),
            (FitStatus.INVALID_INPUT, ~valid),
        ):
            status[which] = kind
            for i in np.flatnonzero(which):
                reasons[i] = kind.words.rstrip(".")
        odd = {}
        for i in np.flatnonzero((status == 0) & ~plain).tolist():
            odd[i] = fit = self.single(i)
            values[i], covariance[i], loss[i] = fit.values, fit.covariance, fit.loss
            dof[i], noise[i], steps[i], reasons[i] = fit.dof, fit.noise, fit.steps, fit.reason
            odds = {FitStatus.NOT_CONVERGED: not fit.converged, FitStatus.AT_BOUND: fit.at_bound}
            odds[FitStatus.NOT_IDENTIFIABLE] = fit.unidentified
            status[i] = next(filter(odds.get, odds), status[i])
        bad = status >= FitStatus.NOT_CONVERGED
        values[bad], covariance[bad], loss[bad], noise[bad] = (np.nan,) * 4
        dof[bad] = 0
        others = self.lanes.others_in(self.shared)
        others = [jax.device_put(x) if isinstance(x, np.ndarray) else x for x in others]
        params, numbers = space.tree_of(values, others), (values, covariance, loss, dof, noise)
        return Fits(
            *(self.tables.balls, params, space.names, *numbers, steps, status, tuple(reasons)),
            space.units,
            lambda i: odd[i] if i in odd else self.single(i),
        )

    def assessed(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return which ends are plain: converged, away from bounds, with all parameters determined.

        Also return covariance (B, k, k), degrees of freedom and noise as of `infer`, for others NaN
        or 0.
        """
        ends, lanes, space = self.ends, self.lanes, self.shared.space
        k = len(space.names)
        finite = np.isfinite(ends.jacobian).all(axis=(1, 2)) & np.isfinite(ends.loss)
        jacobian = np.where(finite[:, None, None], ends.jacobian, 0)
        _, s, vt, scale, known, kept = decomposed(jacobian)
        ranked = (s.shape[1] == k) & known.all(axis=1) & kept.all(axis=1)
        below, above = near_bound(space, ends, lanes.theta)
        aside = below | above | creeping(space, ends.step) | ~ends.still
        plain = finite & ranked & ~aside.any(axis=1)

        used = lanes.factor > 0
        dof = np.where(plain, used.sum(axis=1) - k, 0)
        noise, _ = noise_of(self.shared, ends.z, used, dof, self.tables.absolute)
        with np.errstate(all="ignore"):
            basis = np.swapaxes(vt, 1, 2) / s[:, None, :] / scale[:, :, None]
            stretch = space.stretch(ends.values.T).T
            covariance = noise[:, None, None] * (basis @ np.swapaxes(basis, 1, 2))
            covariance = covariance * stretch[:, :, None] * stretch[:, None, :]
        covariance = np.where(plain[:, None, None], covariance, np.nan)
        return plain, covariance, dof, np.where(plain, noise, np.nan)

    def single(self, i: int) -> Fit:
        """Return the fit of one ball, without the points that fill its row."""
        tables, length = self.tables, self.tables.length
        lane, end = rows_of(self.lanes, i), rows_of(self.ends, i)
        real, shapes = tables.real[i], self.shared.shapes
        x = lane.x
        if length is not None:
            shapes = tuple((int(length[i]), *shape[1:]) for shape in shapes)
            x = jax.tree.map(lambda column: column[: length[i]], x)
        end = end._replace(
            history=self.histories[i],
            z=end.z[real],
            jacobian=end.jacobian[real],
            prediction=end.prediction[real],
        )
        own = lane._replace(x=x, y=lane.y[real], factor=lane.factor[real])
        with in_double():
            problem = jax.tree.map(
                lambda x: jax.device_put(x) if isinstance(x, np.ndarray | np.generic) else x,
                dataclasses.replace(own.problem(self.shared), shapes=shapes),
            )
            how = tables.absolute, np.zeros(0), None, self.options
            end = set_to_bound(problem, end, lane.theta, self.options)
            return result_of(problem, end, lane.theta, *how, True)

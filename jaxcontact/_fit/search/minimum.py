"""A search for the minimum by Levenberg-Marquardt or an optimiser of optax, and the numbers for its
verdict, compiled together.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..._program import quick, soon_options
from ..problem.problem import FitProblem, Point, shortened, shortened_slope
from .trust_region import Search, begin, here_at, least_squares, scale_of

MOST_STEPS = 500
"""Default steps of Levenberg-Marquardt."""

PATIENCE = 200
"""Steps without gain after which a gradient method stops."""

_LEVEL = 1e-12
"""Least relative decrease of the loss that a gradient method counts as gain."""


SINGULAR = 1e-7
"""Relative singular value of the Jacobian, with unit columns, that counts as zero.

Derivatives of an event solve are accurate to about 1e-7.
"""

ROUNDING = 16 * float(np.finfo(float).eps)
"""Rounding of residuals relative to the terms of their differences."""

NEGLIGIBLE = 1e-3
"""Remaining step in standard errors that is negligible."""

COARSE = 1e-2
"""Remaining step of a logarithm or logit that counts, even if rounding hides it."""


FARTHEST = 40.0
"""Distance of a logarithm or logit that is its bound, where its slope is 0, or beyond all data."""


class SearchOptions(NamedTuple):
    """Search options: an optax `optimizer`, or None for Levenberg-Marquardt.

    `rtol` decides convergence; it is an array, so that another value does not recompile. `tell` is
    called with the number of each step and its loss.
    """

    rtol: Float[Array, ""]
    optimizer: Any = None
    max_steps: int = MOST_STEPS
    patience: int = PATIENCE
    tell: Callable[[Any, Any], Any] | None = None

    def report(self, step: Array, loss: Array) -> None:
        """Call `tell`, if given, from compiled code."""
        if self.tell is not None:
            jax.debug.callback(self.tell, step, loss)


Numbers = Any
"""Arrays: of JAX while a search is compiled, of NumPy when its end is assessed."""


class SearchEnd(NamedTuple):
    """The end of a search: its best point, its course, and the numbers at that point.

    `history` is the loss after each step (NaN beyond), and `stopped` whether the search ended by
    itself. `z` are the standardised residuals, `jacobian` is dz/dθ, `values` are the parameters,
    and `prediction` is that of all points. `step` is the remaining Gauss-Newton step, and `allowed`
    the largest negligible one, for each coordinate.
    """

    theta: Float[Numbers, " k"]
    history: Float[Numbers, " steps"]
    steps: Int[Numbers, ""]
    stopped: Bool[Numbers, ""]
    loss: Float[Numbers, ""]
    z: Float[Numbers, " n"]
    jacobian: Float[Numbers, "n k"]
    values: Float[Numbers, " k"]
    prediction: Float[Numbers, " n"]
    step: Float[Numbers, " k"] = None
    allowed: Float[Numbers, " k"] = None

    @property
    def still(self) -> Bool[Numbers, " k"]:
        """The mask of converged coordinates."""
        return abs(self.step) <= self.allowed


def end_of(problem: FitProblem, search: Search) -> SearchEnd:
    """Return the end of a search of Levenberg-Marquardt, which is not assessed."""
    here, course = search.here, (search.history, search.step, search.ended)
    return _end(problem, here.theta, here.point, course)


def _end(
    problem: FitProblem, theta: Array, point: Point, course: tuple[Array, Array, Array]
) -> SearchEnd:
    z, jacobian, prediction = point
    here = theta[0], z, jacobian, problem.space.values(theta), prediction
    return SearchEnd(theta, *course, *here)


def searched(problem: FitProblem, start: Float[Array, " k"], options: SearchOptions) -> SearchEnd:
    """Minimise from `start` until the loss no longer falls, or for `max_steps`."""
    if options.optimizer is not None:
        return _gradient_descent(problem, start, options)
    begun = begin(problem, start, options.max_steps)
    return end_of(problem, least_squares(problem, begun, options.max_steps, options.report))


def _gradient_descent(
    problem: FitProblem, start: Float[Array, " k"], options: SearchOptions
) -> SearchEnd:
    import optax

    optimizer = optax.with_extra_args_support(options.optimizer)

    def unfinished(carry: tuple) -> Array:
        _, _, _, _, idle, _, step = carry
        return (idle < options.patience) & (step < options.max_steps)

    def advance(carry: tuple) -> tuple:
        theta, state, best, lowest, idle, history, step = carry
        loss, gradient = jax.value_and_grad(problem.loss)(theta)
        better = loss < lowest * (1 - _LEVEL)
        # The best point is kept even if the gain is too small to count.
        lower = loss < lowest
        best, lowest = jnp.where(lower, theta, best), jnp.where(lower, loss, lowest)
        changes, state = optimizer.update(
            gradient, state, theta, value=loss, grad=gradient, value_fn=problem.loss
        )
        options.report(step, loss)
        moved = jnp.asarray(optax.apply_updates(theta, changes))
        # A step into a region without finite values returns to the best point.
        theta = jnp.where(jnp.all(jnp.isfinite(moved)) & jnp.isfinite(loss), moved, best)
        idle = jnp.where(better, 0, idle + 1)
        return theta, state, best, lowest, idle, history.at[step].set(loss), step + 1

    history = jnp.full(options.max_steps, jnp.nan, start.dtype)
    zero = jnp.zeros((), int)
    first = (start, optimizer.init(start), start, jnp.asarray(jnp.inf), zero, history, zero)
    _, _, best, _, idle, history, step = jax.lax.while_loop(unfinished, advance, first)
    return _end(problem, best, problem.at(best), (history, step, idle >= options.patience))


def assessed(
    problem: FitProblem, found: SearchEnd, rtol: Float[Numbers, ""], xp: Any = jnp
) -> SearchEnd:
    """Return the end of a search with its loss and its distance from a minimum."""
    loss = xp.sum(xp.square(shortened(found.z, problem.threshold, xp))) / 2
    return with_step(problem, found._replace(loss=loss), found.jacobian, rtol, xp)


_FEW_POINTS = 1000
"""Largest number of data whose fit takes longer to compile than to run."""

_compiled = eqx.filter_jit(searched)
_quickly_compiled = quick(searched)
_soon_compiled = quick(searched, options=soon_options)
_compiled_all = eqx.filter_jit(eqx.filter_vmap(searched, in_axes=(None, 0, None)))


def find(problem: FitProblem, start: Float[np.ndarray, " k"], options: SearchOptions) -> SearchEnd:
    """Compile and run a search; its end is assessed in NumPy, which is little work.

    A search over few points, or of a prediction with `is_formula`, runs so quickly that it is also
    compiled quickly.
    """
    formula = getattr(problem.predict, "is_formula", False)
    search = _soon_compiled if formula else _compiled
    if problem.y.size <= _FEW_POINTS:
        search = _quickly_compiled
    found = in_numpy(search(problem, jax.device_put(start), options))
    with np.errstate(all="ignore"):
        return assessed(in_numpy(problem), found, np.asarray(options.rtol), np)


def find_all(
    problem: FitProblem, starts: Float[np.ndarray, "lanes k"], options: SearchOptions
) -> SearchEnd:
    """Return the ends of searches from many starts at once, with only their loss assessed."""
    found = in_numpy(_compiled_all(problem, jax.device_put(starts), options))
    with np.errstate(all="ignore"):
        r = shortened(found.z, in_numpy(problem.threshold), np)
        return found._replace(loss=np.sum(np.square(r), axis=1) / 2)


def in_numpy(tree: Any) -> Any:
    """Return a tree with its arrays in NumPy."""
    return jax.tree.map(lambda x: np.asarray(x) if isinstance(x, jax.Array) else x, tree)


@quick
def _natural(problem: FitProblem, theta: Float[Array, " k"]) -> Float[Array, " k"]:
    return scale_of(problem, here_at(problem, theta, jnp.zeros_like(theta)))


def start_scale(problem: FitProblem, theta: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Return a large change of each free coordinate at the start, whatever its unit."""
    scale = np.where(problem.space.has_unit, 1.0, np.abs(theta))
    if (scale == 0).any():
        scale = np.where(scale == 0, np.asarray(_natural(problem, jnp.asarray(theta))), scale)
    return scale


@eqx.filter_jit
def losses(problem: FitProblem, thetas: Float[Array, "lanes k"]) -> Float[Array, " lanes"]:
    """Return the loss at many points."""
    return jax.vmap(problem.loss)(thetas)


def with_step(
    problem: FitProblem,
    found: SearchEnd,
    jacobian: Float[Numbers, "n k"],
    rtol: Float[Numbers, ""],
    xp: Any,
) -> SearchEnd:
    """Return `found` with its remaining step by a Jacobian; zero columns hold coordinates."""
    r = shortened(found.z, problem.threshold, xp)
    usable = shortened_slope(found.z, jacobian, problem.threshold, xp)
    used = problem.factor > 0
    data, terms = (
        xp.linalg.norm(xp.where(used & xp.isfinite(x), x, 0))
        for x in (problem.factor * problem.y, problem.factor * found.prediction)
    )
    # Zero data have no scale of rounding: use the loss at the start.
    blur = ROUNDING * xp.where(data > 0, data + terms, xp.sqrt(2 * found.history[0]))
    r = xp.where(xp.isfinite(r), r, 0)
    # The step to the minimum of |r + J p|. Its errors are the standard error of coordinates, and
    # its change by a rounding of the residuals by `blur`.
    u, s, vt, scale, known, kept = decomposed(usable, xp)
    inverse = xp.where(kept, 1 / xp.where(kept, s, 1), 0)
    step = xp.where(known, -(vt.T @ (inverse * (u.T @ r))) / scale, 0)
    freedom = xp.maximum(xp.sum(used) - xp.sum(kept), 1)
    spread = xp.sqrt(xp.sum(xp.square(vt.T * inverse[None, :]), axis=1)) / scale
    error, resolution = xp.linalg.norm(r) / xp.sqrt(freedom) * spread, blur * spread
    # Steps of a logarithm or a logit are absolute.
    size = xp.where(problem.space.has_unit, 1, xp.maximum(xp.abs(found.theta), error))
    # After a search that was cut off, a small step is no evidence: in a curved valley each step is
    # small compared with the remaining way.
    enough = xp.where(found.stopped, NEGLIGIBLE * error, 0)
    # Rounding may hide the way to a bound: a logarithm so poorly known has not converged.
    resolution = xp.where(problem.space.has_unit, xp.minimum(resolution, COARSE), resolution)
    allowed = xp.maximum(xp.maximum(rtol * size, enough), resolution)
    return found._replace(step=step, allowed=allowed)


def decomposed(jacobian: Float[Numbers, "*lanes n k"], xp: Any = np) -> tuple[Numbers, ...]:
    """Return U, s, Vᵀ of Jacobians whose columns are divided by their lengths, and these.

    Also return which columns have a length (otherwise it is 1), and which s count.
    """
    length = xp.linalg.norm(jacobian, axis=-2)
    known = length > 0
    scale = xp.where(known, length, 1)
    u, s, vt = xp.linalg.svd(jacobian / scale[..., None, :], full_matrices=False)
    return u, s, vt, scale, known, s > SINGULAR * s[..., :1]


def basis_of(jacobian: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n rank"]:
    """Return an orthonormal basis of the directions that the parameters can move."""
    u, *_, kept = decomposed(jacobian)
    return u[:, kept]

"""A search and the numbers that its verdict needs, compiled together."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ._loss import shortened, shortened_slope
from ._problem import Problem
from ._solve import Options, scale_of, search

SINGULAR = 1e-7
"""Singular values of the Jacobian, its columns scaled to length 1, that are smaller than this part
of the largest count as zero: derivatives of an event solve are accurate to about 1e-7."""

_ROUNDING = 16 * float(jnp.finfo(jnp.float64).eps)
"""Of all residuals together, relative to the terms they are the sums of."""

NEGLIGIBLE = 1e-3
"""A remaining step of less than this part of a standard error counts as none."""


Numbers = Any
"""Arrays: of JAX while a search is compiled, of NumPy once its end is judged."""


class Found(NamedTuple):
    """The end of a search: its `Path`, and the numbers that belong to its last point.

    `z` are the standardised residuals, `jacobian` is dz/dθ, `values` are the parameters,
    `prediction` is that of all points; `step` the remaining Gauss-Newton step, `allowed` the
    largest that counts as none, for each coordinate.
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
        """Which coordinates have converged."""
        return abs(self.step) <= self.allowed


def found_from(problem: Problem, start: Float[Array, " k"], options: Options) -> Found:
    """Search from `start`, and the distance of its end from a minimum."""
    path, end = search(problem, start, options)
    loss = jnp.sum(jnp.square(shortened(end.z, problem.threshold))) / 2
    values = problem.space.values(path.theta)
    found = Found(*path, loss, end.z, end.jacobian, values, end.prediction)
    return with_step(problem, found, end.jacobian, options.rtol)


find = eqx.filter_jit(found_from)
"""`found_from`, compiled."""

find_all = eqx.filter_jit(eqx.filter_vmap(found_from, in_axes=(None, 0, None)))
"""`find` from many starts (lanes, k) at once."""


@eqx.filter_jit
def _natural(problem: Problem, theta: Float[Array, " k"]) -> Float[Array, " k"]:
    return scale_of(problem, problem.at(theta)).change


def start_scale(problem: Problem, theta: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """What counts as a large change of each free coordinate at the start, whatever its unit."""
    scale = np.where(problem.space.has_unit, 1.0, np.abs(theta))
    if (scale == 0).any():
        scale = np.where(scale == 0, np.asarray(_natural(problem, jnp.asarray(theta))), scale)
    return scale


@eqx.filter_jit
def losses(problem: Problem, thetas: Float[Array, "lanes k"]) -> Float[Array, " lanes"]:
    """The loss at many points."""
    return jax.vmap(problem.loss)(thetas)


def with_step(
    problem: Problem, found: Found, jacobian: Float[Numbers, "n k"], rtol: Float[Array, ""]
) -> Found:
    """`found` with its remaining step by a Jacobian, in which columns of zeros hold coordinates."""
    r = shortened(found.z, problem.threshold)
    usable = shortened_slope(found.z, jacobian, problem.threshold)
    used = problem.factor > 0
    data, terms = (
        jnp.linalg.norm(jnp.where(used & jnp.isfinite(x), x, 0))
        for x in (problem.factor * problem.y, problem.factor * found.prediction)
    )
    # Data of zeros are met to the last bit of whatever the search began with.
    blur = _ROUNDING * jnp.where(data > 0, data + terms, jnp.sqrt(2 * found.history[0]))
    r = jnp.where(jnp.isfinite(r), r, 0)
    step, error, resolution = _gauss_newton(usable, r, jnp.sum(used), blur)
    # Steps of a logarithm or a logit are absolute.
    size = jnp.where(problem.space.has_unit, 1, jnp.maximum(jnp.abs(found.theta), error))
    allowed = jnp.maximum(jnp.maximum(rtol * size, NEGLIGIBLE * error), resolution)
    return found._replace(step=step, allowed=allowed)


compiled_step = eqx.filter_jit(with_step)


def _gauss_newton(
    jacobian: Float[Array, "n k"], r: Float[Array, " n"], used: Int[Array, ""], blur: Array
) -> tuple[Float[Array, " k"], Float[Array, " k"], Float[Array, " k"]]:
    """The step to the minimum of |r + J p|, the standard error of each coordinate, and the change
    of it that a rounding of the residuals by `blur` makes.
    """
    length = jnp.linalg.norm(jacobian, axis=0)
    known = length > 0
    scale = jnp.where(known, length, 1)
    u, s, vt = jnp.linalg.svd(jacobian / scale[None, :], full_matrices=False)
    kept = s > SINGULAR * jnp.max(s)
    inverse = jnp.where(kept, 1 / jnp.where(kept, s, 1), 0)
    step = -(vt.T @ (inverse * (u.T @ r))) / scale
    freedom = jnp.maximum(used - jnp.sum(kept), 1)
    noise = jnp.linalg.norm(r) / jnp.sqrt(freedom)
    spread = jnp.sqrt(jnp.sum(jnp.square(vt.T * inverse[None, :]), axis=1)) / scale
    return jnp.where(known, step, 0), noise * spread, blur * spread

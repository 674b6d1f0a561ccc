"""The residuals of a fit as a function of the free coordinates, so that they compile once, and the
loss: squares, or Huber's loss for data with outliers.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..._entry import POSITIVE, as_own, as_parameter, real_array, refusal, require_number
from .space import Space


@dataclasses.dataclass(frozen=True)
class Huber:
    """Squares up to `threshold` standard deviations, absolute values beyond.

    ρ(z) = z²/2 for |z| ≤ k, k |z| - k²/2 beyond. With k = 1.345 it loses 5 % of the efficiency of
    squares if there are no outliers. Raises ValueError unless `threshold` is positive.

    Source: Huber (1964), Ann. Math. Stat. 35:73, doi 10.1214/aoms/1177703732.
    """

    threshold: float = 1.345

    def __post_init__(self) -> None:
        threshold = require_number("threshold", self.threshold, POSITIVE)
        object.__setattr__(self, "threshold", threshold)


def shortened(
    z: Float[Array, " n"], threshold: Float[Array, ""] | None, xp: Any = jnp
) -> Float[Array, " n"]:
    """Return residuals whose squares are twice the loss (z, or ±√(2ρ(z))), by JAX or NumPy."""
    if threshold is None:
        return z
    far = xp.abs(z) > threshold
    size = xp.where(far, xp.abs(z), 2 * threshold)
    return xp.where(far, xp.sign(z) * xp.sqrt(threshold * (2 * size - threshold)), z)


def shortened_slope(
    z: Float[Array, " n"],
    jacobian: Float[Array, "n k"],
    threshold: Float[Array, ""] | None,
    xp: Any = jnp,
) -> Float[Array, "n k"]:
    """Return the derivative of `shortened` residuals from that of z, 0 where that is not finite.

    Zeros hide no failure: where the prediction is not finite, the loss is not finite either.
    """
    usable = xp.where(xp.isfinite(jacobian), jacobian, 0)
    if threshold is None:
        return usable
    # d√(2ρ)/dz = ψ/r, which is 1 where ρ is a square.
    far = xp.abs(z) > threshold
    r = xp.where(far, xp.abs(shortened(z, threshold, xp)), 1)
    return usable * xp.where(far, threshold / r, 1)[:, None]


class Point(NamedTuple):
    """The evaluation at a point: z, dz/dθ and the prediction of all points."""

    z: Float[Array, " n"]
    jacobian: Float[Array, "n k"]
    prediction: Float[Array, " n"]


class FitProblem(eqx.Module):
    """A fit problem: the prediction, the space of its parameters, the data.

    Numbers are leaves, so that new ones do not recompile. The prediction is compared by identity,
    unless it is a pytree itself. `whitener` (n, n) makes correlated errors independent.
    """

    predict: Callable[..., Any]
    space: Space
    x: Any
    y: Float[Array, " n"]
    factor: Float[Array, " n"]
    threshold: Float[Array, ""] | None
    reverse: bool = eqx.field(static=True)
    shapes: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    whitener: Float[Array, "n n"] | None = None

    @property
    def columns(self) -> Int[np.ndarray, " n"]:
        """The number of the column of each point, that of its leaf of the data."""
        sizes = [math.prod(shape) for shape in self.shapes]
        return np.repeat(np.arange(len(sizes)), sizes)

    @property
    def limit(self) -> Any:
        """The threshold of Huber's loss; infinite for squares."""
        return np.inf if self.threshold is None else self.threshold

    def prediction(self, theta: Float[Array, " k"]) -> Float[Array, " n"]:
        """Return the prediction as one vector; raise ValueError unless it has the data's shapes."""
        got = evaluated(self.predict, self.space.tree_of(self.space.values(theta)), self.x)
        shapes = shapes_of(got)
        if shapes != self.shapes:
            raise ValueError(
                f"Argument `predict` must return the shape of `data`, {_text_of(self.shapes)}, but "
                f"returns {_text_of(shapes)}."
            )
        return flattened(got)

    def standardised(self, prediction: Float[Array, " n"], xp: Any = jnp) -> Float[Array, " n"]:
        """Return z = (prediction - data)/σ, zero for points without weight, whitened."""
        used = self.factor > 0
        z = xp.where(used, xp.where(used, prediction - self.y, 0) * self.factor, 0)
        return z if self.whitener is None else self.whitener @ z

    def residual(self, theta: Float[Array, " k"]) -> Float[Array, " n"]:
        """Return the residuals that are squared and summed."""
        return shortened(self.standardised(self.prediction(theta)), self.threshold)

    def loss(self, theta: Float[Array, " k"]) -> Float[Array, ""]:
        """Return ½ Σ residual²."""
        return jnp.sum(jnp.square(self.residual(theta))) / 2

    def at(self, theta: Float[Array, " k"]) -> Point:
        """Return standardised residuals and their derivatives."""

        def twice(theta: Float[Array, " k"]) -> tuple[Array, tuple[Array, Array]]:
            prediction = self.prediction(theta)
            z = self.standardised(prediction)
            return z, (z, prediction)

        jacobian, (z, prediction) = self.jacobian(twice, theta)
        return Point(z, jacobian, prediction)

    def jacobian(
        self, function: Callable, at: Float[Array, " k"]
    ) -> tuple[Float[Array, "n k"], Any]:
        """Return the derivative of the first of a function's two results, and the second."""
        return (jax.jacrev if self.reverse else jax.jacfwd)(function, has_aux=True)(at)


def as_place(leaf: Any) -> Any:
    """Return an array of `x` of a prediction; raise ValueError if JAX cannot hold it."""
    # A prediction may index by flags, or compute with complex numbers.
    flags = isinstance(leaf, bool | np.bool_) or (type(leaf) is np.ndarray and leaf.dtype == bool)
    if isinstance(leaf, jax.Array):
        return leaf
    return as_own(leaf if flags or np.iscomplexobj(leaf) else real_array(leaf, "x"))


def place_like(x: Any, known: Any) -> Any:
    """Return another `x` with the structure of the data's, `known`; raise ValueError otherwise."""
    if isinstance(known, jax.Array) and jnp.issubdtype(known.dtype, jnp.floating):
        return as_parameter(x, "x").astype(known.dtype)
    place = jax.tree.map(as_place, x)
    wanted, got = jax.tree.structure(known), jax.tree.structure(place)
    if wanted != got:
        what = "None, as in the fit" if known is None else f"a tree like that of the fit, {wanted}"
        raise refusal("x", f"be {what}", x)
    return place


def evaluated(predict: Callable[..., Any], params: Any, x: Any) -> Any:
    """Return the prediction at `x`, which is omitted if None."""
    return predict(params) if x is None else predict(params, x)


def flattened(tree: Any) -> Float[Array, " n"]:
    """Return all numbers of a tree as one vector of double precision."""
    return jnp.concatenate([jnp.ravel(leaf).astype(float) for leaf in jax.tree.leaves(tree)])


def shapes_of(tree: Any) -> tuple[tuple[int, ...], ...]:
    """Return the shapes of the leaves; a single number counts as a list of one."""
    return tuple(np.shape(leaf) or (1,) for leaf in jax.tree.leaves(tree))


def _text_of(shapes: tuple[tuple[int, ...], ...]) -> str:
    return str(shapes[0]) if len(shapes) == 1 else str(shapes)

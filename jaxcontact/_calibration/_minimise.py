"""Minimising a smooth function of a few unconstrained numbers: L-BFGS, compiled, to convergence."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Loss = Callable[..., Float[Array, ""]]

GRADIENT_TOLERANCE = 1e-8
"""Relative to 1 + loss: in float64 the rounding of a mean of squares leaves about 1e-13."""

MAX_EVALUATIONS = 200

_SUFFICIENT_DECREASE = 1e-4
_SHORTEST_STEP = 1e-12
_ROUNDING = 1e-12


@dataclasses.dataclass(frozen=True)
class Minimum:
    """Where `minimise` ended.

    `parameters` (k,), the loss there, the norm of its gradient, how often the loss was evaluated,
    whether it converged, and in words why it stopped.
    """

    parameters: Array
    loss: float
    gradient_norm: float
    evaluations: int
    converged: bool
    reason: str


def minimise(
    loss: Loss, start: Array, *data: Any, max_evaluations: int = MAX_EVALUATIONS
) -> Minimum:
    """Minimise `loss(parameters, *data)` from `start` (k,) by L-BFGS (optax) with backtracking.

    Converged means a gradient norm of at most `GRADIENT_TOLERANCE` (1 + |loss|). `loss` must be
    hashable (it selects the compiled code) and differentiable; `data` are pytrees of arrays.
    Raises ValueError if `max_evaluations` is not positive or the loss is not finite at the start.
    Source: Nocedal & Wright (2006), Numerical Optimization, Alg. 7.4,
    doi 10.1007/978-0-387-40065-5.
    """
    if max_evaluations < 1:
        raise ValueError(
            f"Argument `max_evaluations` must be positive, but is {max_evaluations!r}."
        )
    end = _minimise(loss, max_evaluations, start, data)
    value, norm = float(end.value), float(jnp.linalg.norm(end.gradient))
    if not jnp.isfinite(value) or not jnp.isfinite(norm):
        raise ValueError(
            "Argument `start` must have a finite loss and gradient, but has "
            f"{value!r} and {norm!r}."
        )
    converged = norm <= GRADIENT_TOLERANCE * (1 + abs(value))
    if converged:
        reason = "the gradient vanishes"
    elif int(end.count) >= max_evaluations:
        reason = f"{max_evaluations} evaluations were not enough"
    else:
        reason = "the line search found no better point"
    return Minimum(end.parameters, value, norm, int(end.count), converged, reason)


def _usual_promotion() -> contextlib.AbstractContextManager[None]:
    """For optax, which mixes integer and float counts, where the user asks JAX to be strict."""
    return jax.numpy_dtype_promotion("standard")


class _Search(NamedTuple):
    parameters: Array
    value: Array
    gradient: Array
    direction: Array
    step: Array
    memory: Any
    count: Array


@functools.partial(jax.jit, static_argnames=("loss", "max_evaluations"))
def _minimise(loss: Loss, max_evaluations: int, start: Array, data: tuple[Any, ...]) -> _Search:
    # Imported here: whoever fits nothing needs no optax.
    import optax

    lbfgs = optax.scale_by_lbfgs()

    def unfinished(search: _Search) -> Array:
        steep = jnp.linalg.norm(search.gradient) > GRADIENT_TOLERANCE * (1 + jnp.abs(search.value))
        able = (search.step > _SHORTEST_STEP) & (search.count < max_evaluations)
        return (search.count == 0) | (steep & able)

    def advance(search: _Search) -> _Search:
        # The loss stands here once and nowhere else: compiling it is what a fit waits for, and the
        # line searches of optax hold four copies.
        trial = search.parameters + search.step * search.direction
        value, gradient = jax.value_and_grad(lambda p: loss(p, *data))(trial)
        slope = jnp.vdot(search.gradient, search.direction)
        enough = value <= search.value + _SUFFICIENT_DECREASE * search.step * slope
        # At the bottom the decrease drowns in rounding; there a smaller gradient is progress
        # (Hager & Zhang 2005, doi 10.1137/030601880).
        flat = value <= search.value + _ROUNDING * jnp.abs(search.value)
        enough |= flat & (jnp.linalg.norm(gradient) < jnp.linalg.norm(search.gradient))
        better = (enough & jnp.all(jnp.isfinite(gradient))) | (search.count == 0)
        with _usual_promotion():
            scaled, memory = lbfgs.update(gradient, search.memory, trial)
        scaled = jnp.asarray(scaled)
        downhill = jnp.vdot(scaled, gradient) > 0
        accepted = _Search(
            trial,
            value,
            gradient,
            -jnp.where(downhill, scaled, gradient),
            jnp.ones_like(search.step),
            memory,
            search.count + 1,
        )
        refused = search._replace(step=search.step / 2, count=search.count + 1)
        return jax.tree.map(lambda a, b: jnp.where(better, a, b), accepted, refused)

    zero = jnp.zeros_like(start)
    one = jnp.ones((), start.dtype)
    with _usual_promotion():
        memory = lbfgs.init(start)
    first = _Search(start, one * jnp.inf, zero, zero, one, memory, jnp.zeros((), jnp.int32))
    return jax.lax.while_loop(unfinished, advance, first)

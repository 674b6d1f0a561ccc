"""Plain diffrax: a solve in (x, v) with an event, vmapped."""

from __future__ import annotations

import functools
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from ..until_event import until
from .measure import Solve, Way
from .problems import Problem, function_of

CHUNK = 1000


def impact(
    acceleration: Any,
    numbers: Any,
    rtol: Any,
    solver: diffrax.AbstractSolver,
    adjoint: diffrax.AbstractAdjoint | None = None,
    proportional: float = 0.0,
    atol: float = 1.0,
) -> tuple[jax.Array, jax.Array]:
    """e and duration of one lane; NaN where no end was found.

    `acceleration(x, √x, v, *numbers)`; `atol` in units of `rtol`.
    """

    def rate(t, y, numbers):
        # A root has no slope at 0, hence the usual guard.
        touching = y[0] > 0
        x = jnp.where(touching, y[0], 1.0)
        root = jnp.where(touching, jnp.sqrt(x), 0.0)
        x = jnp.where(touching, x, 0.0)
        return jnp.stack([y[1], acceleration(x, root, y[1], *numbers)])

    solution = until(
        rate, jnp.array([0.0, 1.0]), lambda t, y, args, **_: y[0], rtol, solver=solver,
        args=numbers, atol=atol, most=16_384, proportional=proportional, adjoint=adjoint,
    )  # fmt: skip
    ended = solution.result == diffrax.RESULTS.event_occurred
    return (
        jnp.where(ended, -solution.ys[-1, 1], jnp.nan),
        jnp.where(ended, solution.ts[-1], jnp.nan),
    )


def batch(
    problem: Problem,
    lanes: np.ndarray,
    *,
    solver: type[diffrax.AbstractSolver],
    chunked: bool = False,
    **how: Any,
) -> Solve:
    """A compiled solve of all lanes, or of a thousand at a time, which stay in the cache."""
    acceleration = function_of(problem.acceleration)

    @jax.jit
    def run(p: jax.Array, rtol: jax.Array) -> tuple[jax.Array, jax.Array]:
        def one(p: jax.Array) -> tuple[jax.Array, jax.Array]:
            return impact(acceleration, (p,), rtol, solver(), **how)

        if chunked and p.size > CHUNK:
            return jax.lax.map(one, p, batch_size=CHUNK)
        return jax.vmap(one)(p)

    p = jnp.asarray(lanes)
    return lambda rtol: run(p, jnp.asarray(rtol))


_CONTROLLERS = {"I controller": {}, "PI controller (0.3, 0.4)": {"proportional": 0.3}}
_CHUNKS = {
    f"{name}, a thousand lanes at a time": {**options, "chunked": True}
    for name, options in _CONTROLLERS.items()
}


def _way(solver: type[diffrax.AbstractSolver], **rest: Any) -> Way:
    build = functools.partial(batch, solver=solver)
    return Way(f"diffrax {solver.__name__}", "diffrax", build, **rest)


DIFFRAX = (
    *(
        _way(solver, most=20_000, variants=_CONTROLLERS | _CHUNKS)
        for solver in (diffrax.Tsit5, diffrax.Dopri5, diffrax.Dopri8)
    ),
    _way(diffrax.Kvaerno5, most=200, variants=_CONTROLLERS),
)

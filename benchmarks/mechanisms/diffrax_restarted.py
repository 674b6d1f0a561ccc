"""Plain diffrax, restarted at every event."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp

from ..until_event import until
from .problems import Problem


def call_of(problem: Problem, rtol: float) -> Callable[[], jax.Array]:
    """A scan over phases, each one solve that ends where any gap changes its sign."""
    system, n = problem.system, problem.start["position"].shape[0]
    m = system.gap(0.0, problem.start["position"], None).shape[0]

    def gaps(t, y):
        return jax.jvp(lambda t, q: system.gap(t, q, None), (t, y[:n]), (jnp.ones_like(t), y[n:]))

    def right(t, y, args):
        closed, speed = args
        rate, pull, gap = jax.vjp(
            lambda v: gaps(t, jnp.concatenate([y[:n], v]))[::-1], y[n:], has_aux=True
        )
        push = problem.stiffness * jnp.maximum(-gap, 0) ** 1.5
        push = jnp.where(closed, push * (1 - problem.alpha * rate / speed), 0)
        force = system.force(t, y[:n], y[n:], None) + pull(push)[0]
        return jnp.concatenate([y[n:], jnp.linalg.solve(system.mass(t, y[:n], None), force)])

    def condition(k):
        def of(t, y, args, **_):
            return jnp.where(args[0][k], -1, 1) * system.gap(t, y[:n], None)[k]

        return of

    ends = [condition(k) for k in range(m)]

    def phase(carry, _):
        t, y, closed, speed = carry
        # A small step off the event that has just been met.
        end = until(
            right, y, ends, rtol, args=(closed, speed), start=t, stop=problem.duration,
            first=1e-9 * problem.duration, newton=1e-12, most=10_000,
        )  # fmt: skip
        t, y = end.ts[-1], end.ys[-1]
        met = jnp.stack(end.event_mask) & (t < problem.duration)
        touches = met & ~closed
        speed = jnp.where(touches, -gaps(t, y)[1], speed)
        return (t, y, closed ^ met, speed), jnp.where(jnp.any(touches), t, jnp.inf)

    @jax.jit
    def run(q, v):
        start = jnp.zeros(()), jnp.concatenate([q, v]), jnp.zeros(m, bool), jnp.ones(m)
        return jax.lax.scan(phase, start, length=12)[1]

    q, v = problem.start["position"], problem.start["velocity"]
    return lambda: run(q, v)

"""HLO instructions of loops that end at events: `python benchmarks/loops.py`.

The field has six numbers and three guards. Each loop is counted before optimisation: the march of
event solves, the march with its last step, and diffrax's `diffeqsolve` with three events.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax

jax.config.update("jax_enable_x64", True)

import diffrax
import equinox as eqx
import jax.numpy as jnp
import optimistix

from jaxcontact._solver import Packed, Tolerance, land, march

START = jnp.arange(6.0) / 10 + 1
RTOL = 1e-9


class Swing(eqx.Module):
    """Three oscillators, each with its position as a guard."""

    pace: jax.Array
    one_way = smooth = clamped = False

    def rate(self, state: jax.Array) -> jax.Array:
        return self.pace * jnp.concatenate([state[3:], -state[:3]])

    def guards(self, state: jax.Array) -> tuple[jax.Array, ...]:
        return state[0], state[1], state[2]


def marched(state: jax.Array, pace: jax.Array, rtol: jax.Array) -> Any:
    packed = Packed.of(state)
    last = march(
        Swing(pace), packed, Tolerance(rtol, rtol, 100), rtol, lambda seen, before, now: seen
    )
    return last.after, last.closed


def landed(state: jax.Array, pace: jax.Array, rtol: jax.Array) -> Any:
    field, packed = Swing(pace), Packed.of(state)
    tolerance = Tolerance(rtol, rtol, 100)
    return land(field, packed, march(field, packed, tolerance, rtol, lambda seen, *_: seen))


def by_diffrax(find_root: bool) -> Callable[..., Any]:
    """Return the same motion by `diffeqsolve`, whose events end at a step or at a root."""

    def solve(state: jax.Array, pace: jax.Array, rtol: jax.Array) -> Any:
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(lambda t, y, pace: Swing(pace).rate(y)),
            diffrax.Dopri8(),
            0.0,
            1e3,
            None,
            state,
            pace,
            event=diffrax.Event(
                [lambda t, y, args, i=i, **_: y[i] for i in range(3)],
                optimistix.Newton(1e-13, 1e-13) if find_root else None,
                direction=False,
            ),
            stepsize_controller=diffrax.PIDController(rtol, rtol),
            throw=False,
            adjoint=diffrax.ForwardMode(),
        )
        return found.ys, found.event_mask

    return solve


def instructions(solve: Callable[..., Any]) -> int:
    numbers = START, jnp.asarray(1.0), jnp.asarray(RTOL)
    return jax.jit(solve).lower(*numbers).as_text("hlo").count(" = ")


LOOPS = {
    "march": marched,
    "march and last step": landed,
    "diffeqsolve, ends at a step": by_diffrax(False),
    "diffeqsolve, ends at a root": by_diffrax(True),
}


def main() -> None:
    for name, solve in LOOPS.items():
        print(f"{instructions(solve):6,}  {name}")


if __name__ == "__main__":
    main()

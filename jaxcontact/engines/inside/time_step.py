"""The longest time step at which a contact delivers the restitution of its law."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ... import AbstractLaw, Contact, Status, impact
from ...extend import (
    POSITIVE,
    Range,
    as_numbers,
    problem_of,
    refusal,
    refuses_unknown,
    require_number,
    traced,
)
from .interval import Gaps, StepMotion, law_inside, start_of, substep

ERROR = Range(low=0.0, high=1.0, low_open=True, high_open=True)

_PHASES = 16
"""Examined positions within a substep at which a ball may touch."""

_FEWEST, _MOST, _RATIO, _ALSO = 2.0, 2.0**12, 2**0.125, 4
"""Substeps in a contact that are tried, the ratio of successive numbers, and how many of the next
ones must be good, too, because the error changes its sign.
"""

_LONGEST = 8
"""Contact durations after which a ball that has not left counts as resting."""


@refuses_unknown
def time_step(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    *,
    error: float = 0.01,
    substeps: int = 1,
) -> float:
    """Return the longest time step in s at which `contact_force` keeps the restitution of a law.

    e is then within `error`, relative, of that of the law, wherever in a step the bodies touch. The
    substeps of `contact_force` are run for 16 such positions, without gravity, with more and more
    of them in a contact, until e stays within the error.

    - `law`, `contact`: as in `impact`, scalars, with the effective mass in `contact.mass`.
    - `velocity`: closing speeds in m/s, one or several (n,), all of which are kept.
    - `substeps`: as in `contact_force`. The time step is proportional to it.

    Computes in double precision for any setting of JAX. Raises ValueError for traced arguments,
    which are also those made under `jit`. Also for arguments out of range, for an impact without a
    rebound, and for an error that 4096 substeps in a contact do not reach.
    """
    _require_known(law=law, contact=contact, velocity=velocity)
    substeps = law_inside(law, contact, substeps).substeps
    require_number("error", error, ERROR)
    speeds = np.atleast_1d(as_numbers(velocity, "velocity"))
    if speeds.ndim > 1 or not speeds.size or not POSITIVE.holds(speeds).all():
        raise refusal("velocity", "be one positive speed, or several of the shape (n,)", velocity)
    if shape := problem_of(law, contact, 1.0).shape:
        raise ValueError(
            f"Arguments `law` and `contact` must be scalars, but have the shape {shape}."
        )
    with jax.enable_x64(True), jax.ensure_compile_time_eval():
        hits = impact(law, contact, jnp.asarray(speeds), throw=False)
        target, duration = np.asarray(hits.restitution), np.asarray(hits.duration)
        if not np.all((np.asarray(hits.status) == Status.SEPARATED) & (target > 0)):
            raise ValueError(
                "Arguments `law`, `contact` and `velocity` must make an impact with a rebound, but "
                f"e is {target}."
            )
        count, good = _FEWEST, 0
        while good <= _ALSO and count < _MOST:
            e = _rebounds(law, contact, *map(jnp.asarray, (speeds, duration / count)))
            good = good + 1 if np.max(np.abs(e / target[:, None] - 1)) <= error else 0
            count *= _RATIO
    if good <= _ALSO:
        raise ValueError(
            f"Argument `error` must be one that {_MOST:g} substeps in a contact reach, but is "
            f"{error:g}."
        )
    return float(substeps * duration.min() / (count / _RATIO**good))


@eqx.filter_jit
def _rebounds(
    law: AbstractLaw, contact: Contact, velocity: Float[Array, " n"], length: Float[Array, " n"]
) -> Float[Array, "n phases"]:
    """Return e at each speed, with substeps of these lengths, for each position of the touch."""
    phases = jnp.linspace(1 / _PHASES, 1.0, _PHASES)
    depth = jnp.outer(-velocity * length, phases)
    speed, k = (jnp.repeat(x, _PHASES) for x in (velocity, length))
    still = jnp.zeros_like(speed)
    gaps = Gaps(depth.ravel(), speed, still, jnp.eye(speed.size) / contact.mass)

    def advance(state: tuple[Any, StepMotion]) -> tuple[Any, StepMotion]:
        number, now = state
        return number + 1, substep(law, contact, gaps, now, k)

    def going(state: tuple[Any, StepMotion]) -> Any:
        number, now = state
        return jnp.any((now.depth > 0) | (now.speed > 0)) & (number < _LONGEST * _MOST)

    now = jax.lax.while_loop(going, advance, (0, start_of(gaps, still)))[1]
    return (-now.speed / speed).reshape(depth.shape)


def _require_known(**arguments: Any) -> None:
    for name, value in arguments.items():
        if traced(value):
            raise ValueError(
                f"Argument `{name}` must have concrete numbers, but is traced by `jit`, `vmap` or "
                "`grad`. Call `time_step` outside, with the numbers that have the shortest "
                "contact, and use its result inside."
            )

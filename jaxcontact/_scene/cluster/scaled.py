"""The entry point of the coupled solve: tolerance, units of input and start."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..._contact import Contact
from ..._coupled.field import LoopRules
from ..._coupled.rows import rows_of
from ..._coupled.scalars import Flag, Number
from ..._impact.derivatives import with_sensitivity
from ..._laws import AbstractLaw
from .equations import ClusterPairs, ClusterState, Drive, PerBody
from .friction import PairFriction
from .problem import ClusterEnd, ClusterProblem
from .solve import solve_cluster

MOST_STEPS = 4096


def cluster(
    law: AbstractLaw,
    contact: Contact,
    pairs: ClusterPairs,
    inverse_mass: Float[Array, " bodies"],
    acceleration: PerBody,
    state: ClusterState,
    until: Number,
    *,
    rtol: float | Number,
    v0: str | float = "peak",
    until_change: bool = False,
    drive: Drive | None = None,
    in_line: bool = False,
    friction: PairFriction | None = None,
    to_the_end: Flag | bool = False,
    max_steps: int = MOST_STEPS,
) -> ClusterEnd:
    """Follow a cluster of touching bodies until all its pairs are open, or until a time in s.

    - `law`, `contact`: the law, and effective masses and stiffnesses; scalars or one number a pair.
    - `pairs`: the pairs that can touch.
    - `inverse_mass`: in 1/kg, 0 for fixed and prescribed bodies, which keep their velocity.
    - `acceleration`: of each body by gravity, in m/s².
    - `state`, `until`: the start, and the end time in s.
    - `rtol`: bounds the error of velocities relative to the speeds in the cluster; at least 1e-5 in
      float32.
    - `v0`: "peak", the largest closing speed since touch; "touch", the speed at touch; a number,
      the least speed at touch in m/s.
    - `until_change`: if True, the solve also ends if a pair touches or opens.
    - `drive`: the accelerations of prescribed bodies; None if there are none.
    - `in_line`: if True, a shorter computation in one dimension without shells is used.
    - `friction`: the numbers of friction, with a state that holds its springs; None without.
    - `to_the_end`: if True, the solve continues at rest.

    One lane; batch with `vmap`. Differentiable in both modes: the solve carries the sensitivities
    to all varying numbers. Nothing is raised; see `ClusterEnd.status`.
    """
    dtype = state.position.dtype
    pairs_shape = pairs.used.shape

    def per_pair(leaf: Any) -> Any:
        return jnp.broadcast_to(jnp.asarray(leaf, dtype), pairs_shape)

    law, contact = jax.tree.map(per_pair, (law, contact))
    finest = 20 * float(jnp.finfo(dtype).eps)
    tolerance = jnp.maximum(jnp.asarray(rtol, dtype) / 100, finest)
    problem = ClusterProblem(
        law=law,
        contact=contact,
        pairs=pairs,
        inverse_mass=inverse_mass,
        acceleration=acceleration,
        state=state,
        until=jnp.asarray(until, dtype),
        tolerance=jax.lax.stop_gradient(tolerance),
        floor=jnp.asarray(0.0 if isinstance(v0, str) else v0, dtype),
        drive=drive,
        to_the_end=jnp.asarray(to_the_end),
        friction=friction,
    )
    rules = LoopRules(
        v0 == "peak",
        until_change,
        max_steps,
        sticks=friction is not None,
        remembers=law.remembers,
        forgets=law.forgets,
        fades=law.fades,
        jumps=law.jumps(contact.exponent),
    )
    if law.remembers and state.deepest is None:
        fresh = state._replace(deepest=jnp.zeros_like(state.indentation))
        problem = problem._replace(state=fresh)
    return with_sensitivity(eqx.Partial(solve_cluster, rules=rules, in_line=in_line))(problem)


def cluster_at_touch(
    pairs: ClusterPairs,
    position: PerBody,
    velocity: PerBody,
    closed: Bool[Array, " pairs"],
    *,
    v0: str | float = "peak",
) -> ClusterState:
    """Return a cluster at time 0, with some pairs just touching (δ = 0) and the others open. v0
    rises for pairs that touch without closing yet.
    """
    relative = rows_of(velocity, pairs.first) - rows_of(velocity, pairs.second)
    gap, opening = pairs.gaps(pairs.between(position), relative)
    closed, rate, zero = closed & pairs.used, -opening, jnp.zeros_like(gap)
    # The depth of a pair that just touches is rounding, but has a derivative.
    depth = jnp.where(closed, jax.lax.stop_gradient(gap) - gap, jnp.minimum(-gap, 0))
    latched = jnp.maximum(rate, 0.0 if isinstance(v0, str) else v0)
    return ClusterState(
        time=jnp.zeros((), position.dtype),
        position=position,
        velocity=velocity,
        indentation=jnp.where(pairs.used, depth, 0),
        closed=closed,
        rising=closed & (rate <= 0) & (v0 == "peak"),
        latched=jnp.where(closed, latched, 0),
        since=zero,
        force_until=zero,
        parting=zero,
        max_force=zero,
        lost=zero,
    )

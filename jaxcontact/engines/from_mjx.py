"""Mechanisms from models of MuJoCo MJX."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from .. import AbstractFriction, AbstractLaw, System
from ..extend import refuses_unknown, rendered, require_kind
from ..systems import SystemStart
from .inside.interval import relaxed


@refuses_unknown
def from_mjx(
    model: Any,
    gap: Callable[..., Array],
    *,
    law: AbstractLaw,
    stiffness: ArrayLike,
    exponent: ArrayLike = 1.5,
    friction: AbstractFriction | None = None,
    slip: Callable[..., Array] | None = None,
) -> tuple[System, SystemStart]:
    """Return the motion of a MuJoCo model with contacts of this package, and its start.

    M(q) v' = passive forces - bias(q, v) + Σ F_k ∇g_k, with MJX's mass matrix and bias. MuJoCo's
    own contacts, constraints and actuators take no part.

    - `model`: a `mujoco.MjModel`.
    - `gap(t, sites, args)`: the distances (m,) in m, from the world positions (s, 3) of all sites.
    - `slip(t, sites, speeds, args)`: the tangential speeds, from positions and velocities of sites.

    The other arguments are those of `System`. The numbers of the model are static: a derivative by
    one of them is taken by building the system from a changed model. The start is `qpos0` at rest.
    Raises ImportError without MJX, which `pip install mujoco-mjx` installs, and ValueError for
    anything but a model. Source: mujoco.readthedocs.io/en/stable/mjx.html.
    """
    _, mjx = mujoco_and_mjx("from_mjx", model)
    if not callable(gap):
        raise ValueError(f"Argument `gap` must be a function, but is {rendered(gap)}.")
    engine, plain = mjx.put_model(model), mjx.make_data(model)

    def at(q: Array, v: Array | None = None) -> Any:
        """Return MJX's data of a state."""
        data = plain.replace(qpos=q) if v is None else plain.replace(qpos=q, qvel=v)
        data = mjx.com_pos(engine, mjx.kinematics(engine, data))
        return data if v is None else mjx.com_vel(engine, data)

    @relaxed()
    def mass(t: Array, q: Array, args: Any) -> Array:
        return mjx.full_m(engine, mjx.crb(engine, at(q))).astype(q.dtype)

    @relaxed()
    def force(t: Array, q: Array, v: Array, args: Any) -> Array:
        data = mjx.passive(engine, mjx.rne(engine, at(q, v)))
        return (data.qfrc_passive - data.qfrc_bias).astype(q.dtype)

    @relaxed()
    def sites(q: Array) -> Array:
        return mjx.kinematics(engine, plain.replace(qpos=q)).site_xpos.astype(q.dtype)

    def gaps(t: Array, q: Array, args: Any) -> Array:
        return gap(t, sites(q), args)

    rate = rate_of(np.asarray(model.jnt_type)) if model.nq != model.nv else None

    def slips(t: Array, q: Array, v: Array, args: Any) -> Array:
        assert slip is not None
        along = v if rate is None else rate(t, q, v, args)
        return slip(t, *jax.jvp(sites, (q,), (along,)), args)

    system = System(
        mass,
        force,
        gaps,
        law=law,
        stiffness=stiffness,
        exponent=exponent,
        friction=friction,
        slip=None if slip is None else slips,
        rate=rate,
    )
    start = jnp.asarray(model.qpos0)
    return system, SystemStart(position=start, velocity=jnp.zeros(model.nv, start.dtype))


def mujoco_and_mjx(caller: str, model: Any) -> tuple[Any, Any]:
    """Return both modules; ImportError without them, ValueError for anything but a `MjModel`."""
    try:
        import mujoco  # pyright: ignore[reportMissingImports]
        from mujoco import mjx  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ImportError(f"{caller} needs MJX, which `pip install mujoco-mjx` installs") from error
    require_kind("model", model, mujoco.MjModel, "a `MjModel`")
    return mujoco, mjx


_FREE, _BALL = 0, 1
"""MuJoCo's numbers of joint types whose positions hold a quaternion."""


def rate_of(kinds: np.ndarray) -> Callable[..., Array]:
    """Return q' for joints of these types. Angular velocities of bodies are in their own frames."""

    def rate(t: Array, q: Array, v: Array, args: Any) -> Array:
        parts, i, j = [], 0, 0
        for kind in kinds:
            if kind == _FREE:
                parts.append(v[j : j + 3])
                i, j = i + 3, j + 3
            if kind in (_FREE, _BALL):
                parts.append(_turning(q[i : i + 4], v[j : j + 3]))
                i, j = i + 4, j + 3
            else:
                parts.append(v[j : j + 1])
                i, j = i + 1, j + 1
        return jnp.concatenate(parts)

    return rate


def _turning(q: Array, turn: Array) -> Array:
    """Return ½ q ⊗ (0, ω)."""
    w, u = q[0], q[1:]
    return jnp.concatenate([-jnp.sum(u * turn)[None], w * turn + jnp.cross(u, turn)]) / 2

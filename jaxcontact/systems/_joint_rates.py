"""Rates of the joint positions of a MuJoCo model."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

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

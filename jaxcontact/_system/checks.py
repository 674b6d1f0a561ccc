"""Errors of a mechanism's functions and of its start, by name."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .mechanics import Mechanics
from .start import StartChecks


def require_shapes(mechanics: Mechanics, q: Array, v: Array) -> int:
    """Return the number of gaps; raise ValueError for a function with a wrong outcome."""
    system, t = mechanics.system, jnp.zeros((), q.dtype)

    def shape(name: str, *at: Array) -> tuple[int, ...]:
        out: Any = jax.eval_shape(getattr(system, name), *at, mechanics.args)
        if not hasattr(out, "shape") or not jnp.issubdtype(out.dtype, jnp.floating):
            raise ValueError(
                f"Function `{name}` must return an array of floats, but returns {out}."
            )
        return out.shape

    def require(name: str, got: tuple[int, ...], *allowed: tuple[int, ...]) -> None:
        if got not in allowed:
            expected = " or ".join(map(str, allowed))
            raise ValueError(
                f"Function `{name}` must return the shape {expected}, but returns {got}."
            )

    if system.rate is None and q.shape != v.shape:
        raise ValueError(
            f"Argument `velocity` must have the shape of `position`, {q.shape}, unless the system "
            f"has a `rate`, but has {v.shape}."
        )
    n = v.shape[0]
    require("mass", shape("mass", t, q), (n, n))
    require("force", shape("force", t, q, v), (n,))
    gaps = shape("gap", t, q)
    if len(gaps) != 1 or gaps[0] == 0:
        raise ValueError(
            f"Function `gap` must return an array of the shape (m,), but returns {gaps}."
        )
    if system.slip is not None:
        require("slip", shape("slip", t, q, v), gaps, (*gaps, 2))
    if system.rate is not None:
        require("rate", shape("rate", t, q, v), q.shape)
    return gaps[0]


def require_start(checks: StartChecks, has_v0: bool) -> None:
    """Raise ValueError for a start from which no motion follows."""
    found = jax.tree.map(np.asarray, checks)
    if not found.finite:
        raise ValueError("Arguments `position` and `velocity` must be finite, but are not.")
    if not found.symmetric:
        raise ValueError(
            "Function `mass` must return a symmetric matrix, but does not at the start."
        )
    if not found.definite:
        raise ValueError(
            "Function `mass` must return a positive definite matrix at the start, but does not."
        )
    for k, (gap, fine, pressed) in enumerate(
        zip(found.gaps, found.gradients, found.pressed, strict=True)
    ):
        if not np.isfinite(gap):
            raise ValueError(f"Function `gap` must be finite, but gap {k} is {gap} at the start.")
        if not fine:
            raise ValueError(
                f"The gradient of `gap` must be finite, but that of gap {k} is not at the start."
            )
        if pressed and not has_v0:
            raise ValueError(
                f"Gap {k} is {gap} m at the start, in contact for some time, so that the speed at "
                'its touch is unknown; pass v0="peak" or a number.'
            )
    if not found.force:
        raise ValueError("Function `force` must be finite, but is not at the start.")
    if not found.quadratic:
        raise ValueError("Function `lagrangian` must be quadratic in v, but is not at the start.")

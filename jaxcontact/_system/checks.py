"""Errors of a mechanism's functions and of its start, by name."""

from __future__ import annotations

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .mechanics import Mechanics
from .start import StartChecks
from .system import System


def require_shapes(mechanics: Mechanics, q: Array, v: Array) -> int:
    """Return the number of gaps; raise ValueError for a function with a wrong outcome."""
    arrays, others = eqx.partition((mechanics, q, v), eqx.is_array)
    shapes = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), arrays)
    flat = map(jax.tree.flatten, (shapes, others))
    key = tuple((tuple(leaves), structure) for leaves, structure in flat)
    try:
        hash(key)
    except TypeError:
        return _gaps_of.__wrapped__(key)
    return _gaps_of(key)


@functools.lru_cache(maxsize=16)
def _gaps_of(key: tuple[tuple[tuple, Any], ...]) -> int:
    """Check functions by tracing, once for each system and each shape of its numbers."""
    trees = (jax.tree.unflatten(structure, leaves) for leaves, structure in key)
    mechanics, q, v = eqx.combine(*trees)
    system, t = mechanics.system, jax.ShapeDtypeStruct((), q.dtype)

    def shape(name: str, *at: Any) -> tuple[int, ...]:
        def outcome(system: System, *at: Any) -> Any:
            return getattr(system, name)(*at)

        out: Any = eqx.filter_eval_shape(outcome, system, *at, mechanics.args)
        if not hasattr(out, "shape") or not jnp.issubdtype(out.dtype, jnp.floating):
            got = f"a {type(out).__name__}"
            if hasattr(out, "shape"):
                got = f"{out.dtype} of the shape {out.shape}"
            raise ValueError(
                f"Function `{name}` must return an array of real floats, but returns {got}."
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
        slip = shape("slip", t, q, v)
        require("slip", slip, gaps, (*gaps, 2))
        if system.rigid and slip != gaps:
            raise ValueError(
                f"Function `slip` must return the shape {gaps} with `RigidCoulomb`, but returns "
                f"{slip}; in space use `SpringSlider`."
            )
    if system.rate is not None:
        require("rate", shape("rate", t, q, v), q.shape)
    for number in jax.tree.leaves(system.friction):
        if number.shape not in ((), (1,), gaps):
            raise ValueError(
                f"Friction must hold one number, or one for each of {gaps[0]} gaps, but holds an "
                f"array of the shape {number.shape}."
            )
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
    for k, (gap, fine, pressed, idle) in enumerate(
        zip(found.gaps, found.gradients, found.pressed, found.idle, strict=True)
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
        if idle:
            why = "does not close, so that its closing speed has no peak; pass `v0` as a number."
            raise ValueError(f"Gap {k} is {gap} m at the start and {why}")
    if not found.force:
        raise ValueError("Function `force` must be finite, but is not at the start.")
    if not found.affine:
        raise ValueError(
            "Function `slip` must be affine in v, as all speeds are, but is not at the start."
        )
    if not found.quadratic:
        raise ValueError("Function `lagrangian` must be quadratic in v, but is not at the start.")

"""Values as messages show them."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import numpy as np
from jax.core import Tracer

_LONG, _BEGINNING = 300, 100
"""Characters: longer values are shown by their beginning, type and shape."""


def rendered(value: Any) -> str:
    """Return a value as a message shows it; long ones are cut after their beginning."""
    kind = type(value).__name__
    try:
        text = repr(value)
    except Exception:  # a foreign repr may raise anything, as that of 10**4300 does
        return f"an object of type `{kind}`"
    if len(text) <= _LONG:
        return text
    shape = getattr(value, "shape", None)
    more = f" and shape {shape}" if isinstance(shape, tuple) else ""
    return f"{text[:_BEGINNING]}... (of type `{kind}`{more})"


def shown(value: Any) -> str:
    """Return a number in readable form; arrays shortened, traced values by their type."""
    if not eqx.is_array(value) or isinstance(value, Tracer):
        return eqx.tree_pformat(value)
    if value.ndim == 0:
        return f"{value.item():.9g}"
    return np.array2string(np.asarray(value), precision=6, separator=", ", threshold=6)

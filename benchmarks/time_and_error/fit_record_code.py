"""The force of one impact at given times, in numba: one step of eighth order between two times."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np

from .by_numba import FAST
from .pairs import EIGHTH, step_source

_CODE = """
def rate(x, v, p):
    x = max(x, 0.0)
    return v, -x * sqrt(x) * (1 + p * v)

{step}

def sampled(since, alpha, rtol):
    force = zeros(len(since))
    x, v, t = 0.0, 1.0, 0.0
    xk0, vk0 = rate(x, v, alpha)
    h = 0.01
    for i in range(len(since)):
        if since[i] <= 0:
            continue
        while t < since[i]:
            left = since[i] - t
            last = h >= left
            length = left if last else h
            xn, vn, xk, vk, size = step(x, v, xk0, vk0, length, rtol, rtol, alpha)
            if size <= 1:
                x, v, xk0, vk0 = xn, vn, xk, vk
                t = since[i] if last else t + length
            # A step that a sample cut short says nothing against a longer one.
            if size > 1 or not last:
                h = length * min(5.0, max(0.2, 0.9 * size ** -0.125)) if size > 0 else 5 * length
            elif size < 0.1:
                h = max(h, 2 * length)
        if x <= 0:
            break
        force[i] = x * sqrt(x) * (1 + alpha * v)
    return force
"""


@functools.cache
def sampler() -> Any:
    """`sampled(since, alpha, rtol)`: scaled force at scaled times, zero outside the contact."""
    import numba

    scope: dict[str, Any] = {"sqrt": math.sqrt, "zeros": np.zeros}
    exec(_CODE.format(step=step_source(EIGHTH, "x v", "p")), scope)
    for name in ("rate", "step", "sampled"):
        scope[name] = numba.njit(fastmath=FAST)(scope[name])
    return scope["sampled"]

"""Plain diffrax: the limit of friction switched inside the right-hand side, under step control."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp

from ..until_event import until
from .problems import Lanes


def call_of(lanes: Lanes, rtol: float) -> Callable[[], jax.Array]:
    def right(s, y, args):
        (w, v, psi, phi), (chi, alpha) = y, args
        most = w**3 * (1 + alpha * v)
        slope = w * w * (1 + alpha * v) * (1.5 * v - alpha * w**5)
        grows, sign = 1.5 * w * w * psi, jnp.sign(phi)
        slips = (jnp.abs(phi) >= most) & (sign * grows > slope)
        rate = jnp.where(slips, sign * slope, grows)
        held = jnp.clip(phi, -jnp.abs(most), jnp.abs(most))
        return jnp.stack([v / 2, -(w**4) * (1 + alpha * v), -2 * chi * w * held, rate])

    def parts(t, y, args, **_):
        return y[0]

    def impact(psi, chi, alpha):
        start = jnp.stack([0 * psi, 1 + 0 * psi, psi, 0 * psi])
        how = {"args": (chi, alpha), "stop": 20.0, "first": 1e-3, "newton": 1e-12, "most": 4096}
        end = until(right, start, parts, rtol, **how)
        return end.ys[-1][2]

    program = jax.jit(jax.vmap(impact))
    given = [jnp.asarray(x) for x in (lanes.psi, lanes.chi, lanes.alpha)]
    return lambda: program(*given)

"""Restitution of the Kuwabara-Kono contact, as a polynomial in the one number it depends on.

In units of the closing speed the impact depends on one number, s = A (K/m)^(2/5) v0^(1/5). A fit
needs e at hundreds of speeds, many times, with derivatives; ln e(s) is smooth, so a Chebyshev
series through two dozen solved impacts serves for all of them. The adaptive solve itself would not
do: its outcome jumps by its tolerance where its steps change, which stops a line search.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._contact import Contact
from .._elementary import chebyshev
from .._impact import restitution
from .._laws import KuwabaraKono

STRONGEST = 2.0
"""Largest s of the polynomial; e is 0.021 there."""

_NODES = 24
"""Measured error of ln e with 16, 20, 24 and 40 nodes: 2e-8, 1e-9, 1e-9, 1e-9, which is that of the
solve."""


@functools.cache
def _coefficients() -> tuple[float, ...]:
    """Chebyshev coefficients of ln e on [0, `STRONGEST`]."""
    nodes = np.cos((np.arange(_NODES) + 0.5) * np.pi / _NODES)
    # Concrete numbers, even when the first call comes while a fit is being traced.
    with jax.ensure_compile_time_eval(), jax.enable_x64(True):
        strengths = jnp.asarray((nodes + 1) / 2 * STRONGEST)
        e = restitution(KuwabaraKono(A=strengths), Contact(1.0, 1.0, 1.5), 1.0)
        values = np.log(np.asarray(e))
    series = np.polynomial.Chebyshev.fit(nodes, values, _NODES - 1, domain=[-1, 1])
    return tuple(float(c) for c in series.coef)


def viscous_restitution(strength: Float[Array, "..."]) -> Float[Array, "..."]:
    """e for s = A (K/m)^(2/5) v0^(1/5), dimensionless, n = 3/2; differentiable.

    Relative error 2e-9. Below 0 and above `STRONGEST` it keeps its value there. Source: Kuwabara
    & Kono (1987), doi 10.1143/JJAP.26.1230.
    """
    x = jnp.clip(strength, 0.0, STRONGEST) * (2 / STRONGEST) - 1
    return jnp.exp(chebyshev(_coefficients(), x))

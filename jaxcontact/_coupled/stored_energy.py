"""The elastic energy of a contact."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from .._contact import Contact
from .._functions import contraction
from .._laws import AbstractLaw, energies_of
from .scalars import Number


def stored_energy(
    law: AbstractLaw,
    contact: Contact,
    depth: Number,
    speed: Number,
    deepest: Number | None = None,
) -> Number:
    """Return ∫ F(δ, 0) dδ from 0 to `depth` in J; `speed` is the v0 of the law. The energy of an
    open contact, whose `depth` is 0 here, is 0. Gauss's rule is applied in u = √(δ/depth), in which
    forces with powers of δ^½ are polynomials. A law with a memory returns what unloading returns
    and, while it loads, what it will have kept; `deepest` is the largest indentation of a contact
    that unloads, else 0.
    """
    if law.remembers or law.ends_apart:
        loads = jnp.asarray(True) if deepest is None else deepest <= 0
        largest = depth if deepest is None else jnp.where(loads, depth, deepest)
        returned, kept = energies_of(law, depth, contact, speed, largest)
        return returned + jnp.where(loads, kept, 0)
    nodes, weights = np.polynomial.legendre.leggauss(16)
    depth = jnp.maximum(depth, 0)
    still = jnp.zeros_like(depth)

    def integrand(node: Number) -> Number:
        return node * law.force(depth * jnp.square(node), still, contact, speed)

    forces = jax.vmap(integrand)(jnp.asarray((1 + nodes) / 2, depth.dtype))
    return depth * contraction(jnp.asarray(weights, depth.dtype), forces)

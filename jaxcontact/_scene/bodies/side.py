"""On which side of a surface a sphere touches it: outside of a sphere, or inside of a shell.

A shell is a sphere of negative radius: R1 + R2 is then the negative distance of the centres at the
touch, and the line of centres points the other way. All formulas hold with these signs.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float


def side(distance: Float[Array, "..."]) -> Float[Array, "..."]:
    """1 of two spheres, -1 of a sphere in a shell, by the `distance` R1 + R2 of their touch."""
    return jnp.sign(distance)

"""Contact from outside of a sphere or from inside of a shell. A shell is a sphere of negative
radius. R1 + R2 is then the negative distance of the centres at the touch, and the line of centres
points the other way. All formulas hold with these signs.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float


def side(distance: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return 1 for two spheres, -1 for a sphere in a shell, from the `distance` R1 + R2."""
    return jnp.sign(distance)

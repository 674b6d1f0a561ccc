"""A free mass in a box on a shaken spring."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._entry import refuses_unknown
from .._laws import AbstractLaw, HuGuo
from .._system import System
from ._numbers import Drawing, SystemStart, diagonal, positive, real, rectangle, start, vector


class Damper(eqx.Module):
    """The numbers of an impact damper."""

    masses: Float[Array, "2"]
    spring: Float[Array, ""]
    damping: Float[Array, ""]
    clearance: Float[Array, ""]
    shaking: Float[Array, "2"]


class DamperMass(Damper):
    def __call__(self, t: Array, q: Array, args: Any) -> Array:
        return diagonal(*self.masses)


class DamperForce(Damper):
    def __call__(self, t: Array, q: Array, v: Array, args: Any) -> Array:
        amplitude, rate = self.shaking
        base, pace = amplitude * jnp.sin(rate * t), amplitude * rate * jnp.cos(rate * t)
        pull = -self.spring * (q[0] - base) - self.damping * (v[0] - pace)
        return vector(pull, jnp.zeros_like(pull))


class DamperGap(Damper):
    def draw(self, t: Any, q: Any, args: Any) -> Drawing:
        """Return the picture at a time and place, as `jc.plot.animate` takes it."""
        size, (amplitude, rate) = float(self.clearance), np.asarray(self.shaking)
        # The mass is as wide as the clearance; the sides of the box touch it at its height.
        walls = np.array([[q[0] - size, 0], [q[0] + size, 0]])
        base = amplitude * np.sin(rate * t) - 4 * size
        along = np.linspace(base, q[0] - size, 22)
        spring = np.stack([along, 0.2 * size * np.array([0, *[1, -1] * 10, 0])], axis=1)
        shaken = np.array([[base, -size], [base, size]])
        box, mass = (rectangle([x, 0], half) for x, half in ((q[0], size), (q[1], size / 2)))
        return walls, [box, mass, spring, shaken]

    def __call__(self, t: Array, q: Array, args: Any) -> Array:
        return self.clearance / 2 + vector(q[1] - q[0], q[0] - q[1])


@refuses_unknown
def impact_damper(
    masses: ArrayLike | Sequence[float] = (1.0, 0.1),
    clearance: ArrayLike = 0.01,
    *,
    spring: ArrayLike = 1000.0,
    damping: ArrayLike = 0.5,
    shaking: ArrayLike | Sequence[float] = (1e-3, 31.6),
    law: AbstractLaw | None = None,
    stiffness: ArrayLike = 1e7,
) -> tuple[System, SystemStart]:
    """Return a box on a spring whose base is shaken, with a free mass in it, and its start at rest.

    M1 x'' = -k (x - b) - c (x' - b') + contacts and m2 z'' = -contacts, with b = A sin(ω t). The
    coordinates q = (x, z) are those of box and mass in m. The gaps are d/2 + z - x at the left wall
    and d/2 + x - z at the right one.

    `masses` of box and mass are in kg, the `clearance` d in m, `spring` k in N/m, `damping` c in N
    s/m. `shaking` holds A in m and ω in rad/s. `law` is `HuGuo(e=0.7)` by default, `stiffness` is
    in N/m^1.5. Raises ValueError for numbers out of range. Source: Masri & Caughey
    (1966), Journal of Applied Mechanics 33, 586.
    """
    numbers = {
        "masses": positive("masses", masses, (2,)),
        "spring": real("spring", spring),
        "damping": real("damping", damping),
        "clearance": positive("clearance", clearance),
        "shaking": real("shaking", shaking, (2,)),
    }
    system = System(
        DamperMass(**numbers),
        DamperForce(**numbers),
        DamperGap(**numbers),
        law=HuGuo(e=jnp.asarray(0.7)) if law is None else law,
        stiffness=stiffness,
    )
    return system, start([0.0, 0.0], [0.0, 0.0])

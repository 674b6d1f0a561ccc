"""A double pendulum beside a wall."""

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
from ._numbers import Drawing, SystemStart, positive, real, start, vector


class Pendulum(eqx.Module):
    """The numbers of a double pendulum."""

    masses: Float[Array, "2"]
    lengths: Float[Array, "2"]
    gravity: Float[Array, ""]
    wall: Float[Array, ""]


class PendulumMass(Pendulum):
    def __call__(self, t: Array, q: Array, args: Any) -> Array:
        (m1, m2), (l1, l2) = self.masses, self.lengths
        both = m2 * l1 * l2 * jnp.cos(q[0] - q[1])
        return vector((m1 + m2) * l1**2, both, both, m2 * l2**2).reshape(2, 2)


class PendulumForce(Pendulum):
    def __call__(self, t: Array, q: Array, v: Array, args: Any) -> Array:
        (m1, m2), (l1, l2) = self.masses, self.lengths
        turn = m2 * l1 * l2 * jnp.sin(q[0] - q[1])
        weight = self.gravity * vector((m1 + m2) * l1, m2 * l2) * jnp.sin(q)
        return turn * vector(-(v[1] ** 2), v[0] ** 2) - weight


class PendulumGap(Pendulum):
    def draw(self, t: Any, q: Any, args: Any) -> Drawing:
        """Return the picture at a time and place, as `jc.plot.animate` takes it."""
        lengths, reach = np.asarray(self.lengths), float(np.sum(self.lengths))
        masses = np.cumsum(lengths[:, None] * np.stack([np.sin(q), -np.cos(q)], axis=1), axis=0)
        wall = np.array([[self.wall, -reach], [self.wall, 0.2 * reach]])
        return masses, [np.concatenate([np.zeros((1, 2)), masses]), wall]

    def __call__(self, t: Array, q: Array, args: Any) -> Array:
        return jnp.cumsum(self.lengths * jnp.sin(q)) - self.wall


@refuses_unknown
def double_pendulum(
    masses: ArrayLike | Sequence[float] = (1.0, 1.0),
    lengths: ArrayLike | Sequence[float] = (1.0, 1.0),
    *,
    gravity: ArrayLike = 9.81,
    wall: ArrayLike = -0.3,
    angles: ArrayLike | Sequence[float] = (1.0, 1.5),
    law: AbstractLaw | None = None,
    stiffness: ArrayLike = 1e7,
) -> tuple[System, SystemStart]:
    """Return two point masses on rods beside a wall, which both may touch, and their start at rest.

    M = [[(m1 + m2) l1², m2 l1 l2 cos(q1 - q2)], [same, m2 l2²]] in kg m², with the angles q in rad
    from the vertical. The gaps are x1 - wall and x2 - wall, with x1 = l1 sin q1 and x2 = x1 + l2
    sin q2.

    `masses` in kg and `lengths` in m are two positive numbers each, `gravity` is in m/s², `wall` is
    its x in m. `angles` are those at the start. `law` is `HuGuo(e=0.7)` by default, `stiffness` is
    in N/m^1.5. Raises ValueError for numbers out of range. Source of the equations: Levien & Tan
    (1993), doi 10.1119/1.17335.
    """
    numbers = {
        "masses": positive("masses", masses, (2,)),
        "lengths": positive("lengths", lengths, (2,)),
        "gravity": real("gravity", gravity),
        "wall": real("wall", wall),
    }
    both = real("angles", angles, (2,))
    system = System(
        PendulumMass(**numbers),
        PendulumForce(**numbers),
        PendulumGap(**numbers),
        law=HuGuo(e=jnp.asarray(0.7)) if law is None else law,
        stiffness=stiffness,
    )
    return system, start(both, [0.0, 0.0])

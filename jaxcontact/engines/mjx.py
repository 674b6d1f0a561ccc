"""Forces of a contact law on the contact pairs of MuJoCo MJX."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .. import AbstractLaw, Contact
from ..extend import refuses_unknown
from .from_mjx import mujoco_and_mjx, rate_of
from .inside.interval import (
    Action,
    EnginePairs,
    LawInside,
    first_speeds,
    law_inside,
    numbers_of,
    pairs_of,
    relaxed,
    require_per_pair,
    require_same,
)

Carry = Float[Array, " pairs"]

_ONE_POINT = {
    ("plane", "sphere"),
    ("plane", "capsule"),
    ("plane", "ellipsoid"),
    ("sphere", "sphere"),
    ("sphere", "capsule"),
    ("sphere", "box"),
    ("capsule", "capsule"),
}
"""Pairs of geoms whose contact points keep their identity from step to step."""

_RUNGE_KUTTA = 1
"""MuJoCo's number of its integrator RK4."""


class _Parts(NamedTuple):
    """The law, and MJX. `finder` and `plain` are a model and data with the contacts of the law,
    `chosen` their numbers, and `rate` the rate of the joint positions.
    """

    inside: LawInside
    mjx: Any
    finder: Any
    plain: Any
    chosen: np.ndarray
    rate: Callable[..., Array]


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ContactForce:
    """The forces of a law between the geoms of a MuJoCo model, made by `contact_force`.

    - `model`: the `mjx.Model` to step. MuJoCo's own contact of these geoms is off in it.
    - `pairs`: the names of both geoms of each contact, or their numbers. A capsule on a plane has
      two.
    - `init(model, data)`: the state to carry at the start.
    - `step(model, data, carry)`: `data` and `carry` after one time step, in place of `mjx.step`.
    - `(model, data, carry)`: the generalised force (nv,) in N or N m, and `carry`. It is the mean
      over the coming time step, for `data.replace(qfrc_applied=...)` and an integration by other
      means. `step` also corrects the positions for the instant at which the force acts.

    All three are differentiable in both modes by the numbers of the law, the contact, the model and
    the data. `carry` (pairs,) holds the closing speeds v0 in m/s of the last touch.
    """

    model: Any
    pairs: tuple[tuple[str, str], ...]
    _parts: _Parts

    def init(self, model: Any, data: Any) -> Carry:
        """Return the state to carry from `data` on. Bodies that overlap touch with their speed."""
        with relaxed():
            return first_speeds(self._pairs(model, data)[0])

    def __call__(self, model: Any, data: Any, carry: Carry) -> tuple[Float[Array, " nv"], Carry]:
        with relaxed():
            force, action = self._act(model, data, carry)
            return force, action.touch_speed

    def step(self, model: Any, data: Any, carry: Carry) -> tuple[Any, Carry]:
        """Return `data` and `carry` after one time step of the model."""
        with relaxed():
            force, action = self._act(model, data, carry)
            applied = data.qfrc_applied
            after = self._parts.mjx.step(model, data.replace(qfrc_applied=applied + force))
            position = after.qpos + self._parts.rate(None, after.qpos, action.shift, None)
            position = position.astype(after.qpos.dtype)
            return after.replace(qpos=position, qfrc_applied=applied), action.touch_speed

    def _act(self, model: Any, data: Any, carry: Carry) -> tuple[Float[Array, " nv"], Action]:
        """Return the generalised force, and the action of the law."""
        pairs, jacobian = self._pairs(model, data)
        part = 0.5 if int(model.opt.integrator) == _RUNGE_KUTTA else 1.0
        action = self._parts.inside.act(pairs, carry, model.opt.timestep, part)
        return -action.force @ jacobian, action

    def _pairs(self, model: Any, data: Any) -> tuple[EnginePairs, Float[Array, "pairs nv"]]:
        """Return the pairs of a state, and the derivatives of their closing speeds by velocities.

        XLA shares what `mjx.step` computes of it again.
        """
        parts = self._parts
        mjx = parts.mjx
        require_same(model, self.model)
        now = mjx.fwd_velocity(model, mjx.fwd_position(model, data))
        now = mjx.fwd_acceleration(model, mjx.fwd_actuation(model, now))
        # The numbers of the given model, with the contacts that it lacks.
        finder = jax.tree.unflatten(jax.tree.structure(parts.finder), jax.tree.leaves(model))
        seen = parts.plain.replace(geom_xpos=now.geom_xpos, geom_xmat=now.geom_xmat)
        contacts = mjx.collision(finder, seen)._impl.contact
        contacts = jax.tree.map(
            lambda x: x[parts.chosen], (contacts.dist, contacts.pos, contacts.frame, contacts.geom)
        )
        distance, place, frame, geom = contacts
        bodies = jnp.asarray(model.geom_bodyid)[geom]

        def closing(place: Array, normal: Array, bodies: Array) -> Array:
            first, second = (mjx.jac(model, now, place, bodies[k])[0] for k in (0, 1))
            return (first - second) @ normal

        jacobian = jax.vmap(closing)(place, frame[:, 0], bodies)
        speed, acceleration = jacobian @ data.qvel, jacobian @ now.qacc_smooth
        mass = mjx.full_m(model, now)
        return pairs_of(-distance, speed, acceleration, jacobian, mass), jacobian


@refuses_unknown
def contact_force(
    law: AbstractLaw,
    contact: Contact,
    model: Any,
    *,
    geoms: Sequence[str] | None = None,
    substeps: int = 1,
) -> ContactForce:
    """Return the forces of a law on the contact pairs of a MuJoCo model, for MJX.

    F = K δⁿ (1 + α δ'/v0), or any other law without memory. MJX gives distances, normals and
    speeds, and v0 is the speed at the touch, found within the step. Both bodies get the force;
    there is no friction.

    - `law`, `contact`: as in `impact`. K, n and the numbers of the law may be arrays (pairs,). The
      effective mass is that of the bodies in the model, in place of `contact.mass`.
    - `model`: a `mujoco.MjModel`. Geoms are spheres, capsules, planes, and a box or an ellipsoid
      beside one of these, as far as MJX finds one point for each end.
    - `geoms`: names of geoms whose contacts are of the law; MuJoCo keeps all others. Default: all.
    - `substeps`: steps of the contacts alone within each time step of the model. `time_step`
      returns how long a step may be.

    The contacts of a step are solved together, with the mass matrix and normals of its start.
    MuJoCo's equality constraints are not in the effective mass. Raises ImportError without MJX,
    which `pip install mujoco-mjx` installs, and ValueError for a law with memory, `JKR` or
    `WetRestitution`, numbers of another shape, other geoms, or a model that drops contacts. Source:
    mujoco.readthedocs.io/en/stable/mjx.html.
    """
    mujoco, mjx = mujoco_and_mjx("contact_force", model)
    inside = law_inside(law, contact, substeps)
    for name in ("max_contact_points", "max_geom_pairs"):
        if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name) >= 0:
            raise ValueError(
                f"Argument `model` must keep all contacts, but has the custom numeric {name!r}."
            )
    named = [model.geom(k).name or None for k in range(model.ngeom)]
    ours = np.array(numbers_of("geoms", geoms, named), int)
    finder, stepped = copy.copy(model), copy.copy(model)
    contact_off = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    finder.opt.disableflags &= ~contact_off
    if geoms is None:
        stepped.opt.disableflags |= contact_off
    else:
        stepped.geom_contype[ours] = stepped.geom_conaffinity[ours] = 0
        pairs = np.isin(model.pair_geom1, ours) | np.isin(model.pair_geom2, ours)
        stepped.pair_margin[pairs] = -1 / mujoco.mjMINVAL
    # A trace around this has no part in the numbers of a model.
    with jax.ensure_compile_time_eval(), relaxed():
        engine, plain = mjx.put_model(finder), mjx.make_data(finder)
        # Compiled, because nothing but these numbers is then computed.
        found = np.asarray(jax.jit(lambda: mjx.collision(engine, plain)._impl.contact.geom)())
        rate = rate_of(np.asarray(model.jnt_type))
        chosen = np.flatnonzero(np.isin(found, ours).any(axis=1))
        require_per_pair(law, contact, chosen.size, "pairs (`ContactForce.pairs`)")
        return ContactForce(
            model=mjx.put_model(stepped),
            pairs=_names(mujoco, model, found[chosen]),
            _parts=_Parts(inside, mjx, engine, plain, chosen, rate),
        )


def _names(mujoco: Any, model: Any, pairs: np.ndarray) -> tuple[tuple[str, str], ...]:
    """Return the names of both geoms of each contact; ValueError for pairs of other kinds."""
    if not len(pairs):
        raise ValueError("Argument `model` must have contact pairs of these geoms, but has none.")
    named = []
    for pair in pairs:
        kinds = tuple(mujoco.mjtGeom(model.geom_type[k]).name[7:].lower() for k in pair)
        names = tuple(model.geom(k).name or str(k) for k in pair)
        if kinds not in _ONE_POINT:
            raise ValueError(
                "Argument `model` must have contacts of "
                f"{', '.join(f'{a} and {b}' for a, b in sorted(_ONE_POINT))}, but geoms "
                f"{names[0]!r} and {names[1]!r} are {kinds[0]} and {kinds[1]}."
            )
        named.append(names)
    return tuple(named)

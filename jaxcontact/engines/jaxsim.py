"""Forces of a contact law between the points of a JaxSim model and its terrain."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .. import AbstractLaw, Contact
from ..extend import refuses_unknown, require_kind
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

Carry = Float[Array, " points"]
Forces = Float[Array, "links 6"]
Torques = Float[Array, " joints"]

_BASE = 6
"""Velocities of the base, which a model with a fixed base has, too."""


class _LawInJaxSim(NamedTuple):
    """The law, and JaxSim. `found` are the fields of contact parameters with its points alone, and
    `part` is that of `LawInside.act`.
    """

    inside: LawInside
    jaxsim: Any
    found: dict[str, Any]
    part: float


class _AtPoints(NamedTuple):
    """The pairs of a state, the wrench of a unit force at each point, and the world's link forces
    of the user.
    """

    pairs: EnginePairs
    wrenches: Float[Array, "points 6"]
    given: Forces


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class TerrainForce:
    """The forces of a law on collidable points of a JaxSim model, made by `contact_force`.

    - `model`: the `JaxSimModel` to step. JaxSim's own contact of these points is off in it.
    - `points`: the name of the link of each point, in JaxSim's order.
    - `init(model, data)`: the state to carry at the start.
    - `step(model, data, carry)`: `data` and `carry` after one time step, in place of
      `js.model.step`, with the same `link_forces` and `joint_force_references`.
    - `(model, data, carry)`: the forces on the links (links, 6) in N and N m, in the representation
      of `data`, and `carry`. It is the mean over the coming time step, for the `link_forces` of
      `js.model.step`. `step` also corrects the positions for the instant at which the force acts.

    All three are differentiable in both modes by the numbers of the law, the contact, the model and
    the data. `carry` (points,) holds the closing speeds v0 in m/s of the last touch.
    """

    model: Any
    points: tuple[str, ...]
    _parts: _LawInJaxSim

    def init(self, model: Any, data: Any) -> Carry:
        """Return the state to carry from `data` on. Points in the ground touch with their speed."""
        with relaxed():
            return first_speeds(self._at(model, data, None, None).pairs)

    def __call__(
        self,
        model: Any,
        data: Any,
        carry: Carry,
        *,
        link_forces: Forces | None = None,
        joint_force_references: Torques | None = None,
    ) -> tuple[Forces, Carry]:
        with relaxed():
            at = self._at(model, data, link_forces, joint_force_references)
            forces, action = self._act(model, at, carry)
            links = self._parts.jaxsim.api.model.forward_kinematics(model, data)
            own = data.velocity_representation
            forces = data.inertial_to_other_representation(forces, own, links, is_force=True)
            return forces, action.touch_speed

    def step(
        self,
        model: Any,
        data: Any,
        carry: Carry,
        *,
        link_forces: Forces | None = None,
        joint_force_references: Torques | None = None,
    ) -> tuple[Any, Carry]:
        """Return `data` and `carry` after one time step of the model."""
        jaxsim = self._parts.jaxsim
        with relaxed():
            at = self._at(model, data, link_forces, joint_force_references)
            forces, action = self._act(model, at, carry)
            after = jaxsim.api.model.step(
                model,
                dataclasses.replace(data, velocity_representation=jaxsim.VelRepr.Inertial),
                link_forces=at.given + forces,
                joint_force_references=joint_force_references,
            )
            # The velocity of the base itself stays, not that of the origin of the world.
            after = dataclasses.replace(after, velocity_representation=jaxsim.VelRepr.Mixed)
            base, joints = action.shift[:_BASE], action.shift[_BASE:]
            turn = jaxsim.math.Quaternion.derivative(after.base_orientation, base[3:])[:, 0]
            after = after.replace(
                model,
                joint_positions=after.joint_positions + joints,
                base_position=after.base_position + base[:3],
                base_quaternion=after.base_orientation + turn,
                base_linear_velocity=after.base_velocity[:3],
                base_angular_velocity=after.base_velocity[3:],
            )
            own = data.velocity_representation
            return dataclasses.replace(after, velocity_representation=own), action.touch_speed

    def _act(self, model: Any, at: _AtPoints, carry: Carry) -> tuple[Forces, Action]:
        """Return the forces on the links in the world, and the action of the law."""
        inside, jaxsim, _, part = self._parts
        action = inside.act(at.pairs, carry, model.time_step, part)
        forces = jaxsim.api.contact.link_forces_from_contact_forces(
            self._finder(model), contact_forces=action.force[:, None] * at.wrenches
        )
        return forces, action

    def _finder(self, model: Any) -> Any:
        """Return the given model with the points of the law alone."""
        return _with_points(model, self._parts.found)

    def _at(
        self, model: Any, data: Any, link_forces: Forces | None, torques: Torques | None
    ) -> _AtPoints:
        """Return the points of a state. XLA shares what `js.model.step` computes of it again."""
        jaxsim = self._parts.jaxsim
        js = jaxsim.api
        require_same(model, self.model)
        world, mixed = (
            dataclasses.replace(data, velocity_representation=kind)
            for kind in (jaxsim.VelRepr.Inertial, jaxsim.VelRepr.Mixed)
        )
        given = jnp.zeros((model.number_of_links(), _BASE))
        if link_forces is not None:
            links, own = js.model.forward_kinematics(model, data), data.velocity_representation
            given = data.other_representation_to_inertial(link_forces, own, links, is_force=True)
        torques = js.actuation_model.compute_resultant_torques(
            model, world, joint_force_references=torques
        )
        rates = js.ode.system_dynamics(model, world, link_forces=given, joint_torques=torques)
        del rates["contact_state"]
        finder = self._finder(model)

        def kinematics(state: dict[str, Array]) -> tuple[Array, Array]:
            return js.contact.collidable_point_kinematics(finder, world.replace(model, **state))

        (place, speed), (_, acceleration) = jax.jvp(
            kinematics,
            [
                {
                    "base_position": world.base_position,
                    "base_quaternion": world.base_quaternion,
                    "joint_positions": world.joint_positions,
                    "base_linear_velocity": world.base_velocity[:3],
                    "base_angular_velocity": world.base_velocity[3:],
                    "joint_velocities": world.joint_velocities,
                }
            ],
            [rates],
        )
        slope = js.contact.jacobian(finder, mixed, output_vel_repr=jaxsim.VelRepr.Mixed)[:, :3]
        normal = jax.vmap(model.terrain.normal)(place[:, 0], place[:, 1])
        height = jax.vmap(model.terrain.height)(place[:, 0], place[:, 1])

        def closing(along: Array) -> Array:
            return -jnp.einsum("pi,pi...->p...", normal, along)

        free = slice(None if model.floating_base() else _BASE, None)
        mass = js.model.free_floating_mass_matrix(model, mixed)
        pairs = pairs_of(
            depth=(height - place[:, 2]) * normal[:, 2],
            speed=closing(speed),
            acceleration=closing(acceleration),
            jacobian=closing(slope)[:, free],
            mass=mass[free, free],
        )
        if not model.floating_base():
            fixed = jnp.zeros((_BASE, place.shape[0]))
            pairs = pairs._replace(answers=jnp.concatenate([fixed, pairs.answers]))
        return _AtPoints(pairs, jnp.hstack([normal, jnp.cross(place, normal)]), given)


@refuses_unknown
def contact_force(
    law: AbstractLaw,
    contact: Contact,
    model: Any,
    *,
    links: Sequence[str] | None = None,
    substeps: int = 1,
) -> TerrainForce:
    """Return the forces of a law between the points of a JaxSim model and its terrain.

    F = K δⁿ (1 + α δ'/v0), or any other law without memory, at each of the points of which JaxSim
    makes the collision shapes of a link. The force has the normal of the terrain, as does the
    depth, and v0 is the speed at the touch, found within the step. There is no friction.

    - `law`, `contact`: as in `impact`. K, n and the numbers of the law may be arrays (points,).
      Points that touch together share a load, so that each needs its part of K. The effective mass
      is that of the model at the point, in place of `contact.mass`.
    - `model`: a `JaxSimModel` with `SemiImplicitEuler` or `RungeKutta4`. Its enabled points count.
    - `links`: names of links whose points are of the law; JaxSim keeps all others. Default: all.
    - `substeps`: steps of the contacts alone within each time step of the model. `time_step`
      returns how long a step may be.

    A ball has points all over; only one that does not turn and keeps one point enabled, the lowest,
    touches as a ball does. The contacts of a step are solved together, with the mass matrix and
    normals of its start. Kinematic constraints are not in the effective mass. Raises ImportError
    without JaxSim, which `pip install jaxsim` installs, and ValueError for a law with memory, `JKR`
    or `WetRestitution`, numbers of another shape, a model without points, or another integrator.
    Source: jaxsim.readthedocs.io.
    """
    try:
        import jaxsim  # pyright: ignore[reportMissingImports]
        import jaxsim.api  # pyright: ignore[reportMissingImports]
        import jaxsim.rbda.contacts  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ImportError(
            "contact_force needs JaxSim, which `pip install jaxsim` installs"
        ) from error
    inside = law_inside(law, contact, substeps)
    require_kind("model", model, jaxsim.api.model.JaxSimModel, "a `JaxSimModel`")
    parts = {"SemiImplicitEuler": 1.0, "RungeKutta4": 0.5}
    if model.integrator.name not in parts:
        raise ValueError(
            f"Argument `model` must have one of the integrators {', '.join(parts)}, but has "
            f"{model.integrator.name}."
        )
    body = model.kin_dyn_parameters.contact_parameters.body
    enabled = np.array(model.kin_dyn_parameters.contact_parameters.enabled, bool)
    names = model.link_names()
    ours = enabled & np.isin(body, numbers_of("links", links, names))
    if not ours.any():
        raise ValueError("Argument `model` must have collidable points of these links.")
    require_per_pair(law, contact, int(ours.sum()), "points (`TerrainForce.points`)")
    rest = enabled & ~ours
    if rest.any():
        stepped = _with_points(model, {"enabled": tuple(rest.tolist())})
    else:
        # Contact models fail where all points are disabled, and one without bodies is not asked.
        soft = jaxsim.rbda.contacts
        stepped = dataclasses.replace(
            _with_points(model, {"body": (), "enabled": ()}),
            contact_model=soft.SoftContacts.build(),
            contact_params=soft.SoftContactsParams.build(),
        )
    found = {"body": body, "enabled": tuple(ours.tolist())}
    return TerrainForce(
        model=stepped,
        points=tuple(names[body[k]] for k in np.flatnonzero(ours)),
        _parts=_LawInJaxSim(inside, jaxsim, found, parts[model.integrator.name]),
    )


def _with_points(model: Any, fields: dict[str, Any]) -> Any:
    numbers = model.kin_dyn_parameters
    points = dataclasses.replace(numbers.contact_parameters, **fields)
    return dataclasses.replace(
        model, kin_dyn_parameters=dataclasses.replace(numbers, contact_parameters=points)
    )

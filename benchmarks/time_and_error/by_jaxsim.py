"""JaxSim: a box that falls flat on four corners, by its soft contacts."""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp

from .rebounds import MASS, SPEED, Drop

SIDE = 0.2
_MODEL = f"""<sdf version="1.7"><model name="ball"><link name="body">
  <inertial><mass>{MASS}</mass><inertia><ixx>0.01</ixx><ixy>0</ixy><ixz>0</ixz><iyy>0.01</iyy>
  <iyz>0</iyz><izz>0.01</izz></inertia></inertial><collision name="shape"><geometry><box>
  <size>{SIDE} {SIDE} {SIDE}</size></box></geometry></collision></link></model></sdf>"""
CORNERS = 4
"""They share the force; points are all that touches in JaxSim, and a ball would touch by one of
those that are spread over it."""


def solver(drops: list[Drop], *, integrator: str) -> Any:
    import jaxsim.api as js
    from jaxsim.rbda.contacts import SoftContacts, SoftContactsParams

    model = js.model.JaxSimModel.build_from_model_description(
        _MODEL,
        contact_model=SoftContacts.build(),
        integrator=getattr(js.model.IntegratorType, integrator),
        gravity=0.0,
        is_urdf=False,
    )

    def given(drop: Drop) -> tuple[float, float]:
        return drop.numbers["K"] / CORNERS, drop.numbers["D"] / CORNERS

    numbers = jnp.array([given(drop) for drop in drops])

    @functools.partial(jax.jit)
    def thrown(numbers, gaps, step, count):
        def one(pair, gap, step):
            params = SoftContactsParams.build(K=pair[0], D=pair[1], mu=0.0, p=0.5, q=1.5)
            with model.editable(validate=False) as mine:
                mine.contact_params = params
                mine.time_step = step
            data = js.data.JaxSimModelData.build(
                mine,
                base_position=jnp.array([0, 0, SIDE / 2]) + gap * jnp.array([0, 0, 1.0]),
                base_linear_velocity=jnp.array([0, 0, -SPEED]),
            )
            data = jax.lax.fori_loop(0, count, lambda _, d: js.model.step(mine, d), data)
            return data.base_velocity[2]

        return jax.vmap(one)(numbers, gaps, step) / SPEED

    def run(steps: float) -> jax.Array:
        gaps = jnp.array([drop.gap(steps) for drop in drops])
        step = jnp.array([drop.ladder(steps)[0] for drop in drops])
        return thrown(numbers, gaps, step, drops[0].ladder(steps)[1])

    return run

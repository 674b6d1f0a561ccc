"""MuJoCo and MJX: one ball on a plane, with the contact of `solref` in its direct format."""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .rebounds import IMPEDANCE, MASS, RADIUS, SPEED, Drop

_MODEL = """<mujoco>
  <option timestep="{step!r}" gravity="0 0 0" integrator="{integrator}" cone="{cone}">
    <flag warmstart="disable"/></option>
  <worldbody><geom type="plane" size="5 5 1" condim="1" {contact}/>
    <body pos="0 0 {height!r}"><joint type="slide" axis="0 0 1"/>
      <geom type="sphere" size="{radius}" mass="{mass}" condim="1" {contact}/>
    </body>
  </worldbody></mujoco>"""


def contact_of(numbers: Any) -> str:
    k, b = numbers["stiffness"], numbers["damping"]
    return f'solref="{-k!r} {0 - b!r}" solimp="{IMPEDANCE} {IMPEDANCE} 0.001 0.5 2"'


def model_of(drop: Drop, steps: float, integrator: str) -> Any:
    import mujoco

    return mujoco.MjModel.from_xml_string(
        _MODEL.format(
            step=drop.ladder(steps)[0],
            integrator=integrator,
            cone="pyramidal",
            contact=contact_of(drop.numbers),
            height=RADIUS + drop.gap(steps),
            radius=RADIUS,
            mass=MASS,
        )
    )


def solver(drops: list[Drop], *, integrator: str) -> Any:
    """Step after step in C, a drop at a time; models are made once a ladder's step."""
    import mujoco

    @functools.cache
    def built(steps: float) -> list[Any]:
        models = [model_of(drop, steps, integrator) for drop in drops]
        return [(model, mujoco.MjData(model)) for model in models]

    def run(steps: float) -> np.ndarray:
        found = []
        for (model, data), drop in zip(built(steps), drops, strict=True):
            mujoco.mj_resetData(model, data)
            data.qvel[0] = -SPEED
            mujoco.mj_step(model, data, drop.ladder(steps)[1])
            found.append(data.qvel[0])
        return np.array(found) / SPEED

    return run


def by_mjx(drops: list[Drop], *, integrator: str) -> Any:
    """All drops at once: a vmap over what differs between their models."""
    from mujoco import mjx

    @functools.cache
    def built(steps: float) -> Any:
        each = [mjx.put_model(model_of(drop, steps, integrator)) for drop in drops]
        first, tree = jax.tree.flatten(each[0])
        leaves = zip(*(jax.tree.leaves(model) for model in each), strict=True)
        apart = [
            k for k, same in enumerate(leaves) if any(not np.array_equal(same[0], x) for x in same)
        ]
        stacked = [jnp.stack([jax.tree.leaves(model)[k] for model in each]) for k in apart]
        return tree, first, apart, stacked

    @functools.partial(jax.jit, static_argnums=(0, 3))
    def thrown(tree, first, stacked, apart, count):
        def one(own):
            leaves = list(first)
            for k, leaf in zip(apart, own, strict=True):
                leaves[k] = leaf
            model = jax.tree.unflatten(tree, leaves)
            data = mjx.make_data(model)
            data = data.replace(qvel=jnp.full(1, -SPEED))
            return jax.lax.fori_loop(0, count, lambda _, d: mjx.step(model, d), data).qvel[0]

        return jax.vmap(one)(stacked) / SPEED

    def run(steps: float) -> jax.Array:
        tree, first, apart, stacked = built(steps)
        return thrown(tree, first, stacked, tuple(apart), drops[0].ladder(steps)[1])

    return run

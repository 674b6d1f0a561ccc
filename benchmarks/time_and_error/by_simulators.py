"""Exudyn, Drake and MuJoCo, by the programs of `tests/engines/test_export/drops.py`; and MJX.

One ball over a plane, and one after another, but for MJX. Models are built once a ladder's step.
"""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.time_and_error.rebounds import IMPEDANCE, MASS, RADIUS, SPEED, Drop
from tests.engines.test_export import drops as programs

_DRAKE = """<drake:proximity_properties><drake:hunt_crossley_dissipation>
  {hunt_crossley_dissipation!r}</drake:hunt_crossley_dissipation><drake:point_contact_stiffness>
  {point_contact_stiffness!r}</drake:point_contact_stiffness></drake:proximity_properties>"""
_MUJOCO = """<option integrator="{integrator}"><flag warmstart="disable"/></option>
  <default><geom condim="1" solref="{k!r} {b!r}" solimp="{d} {d} 0.001 0.5 2"/></default>"""
COARSEST = 20
"""Steps a contact by which a continuous plant of Drake must not miss it."""


def _snippet(engine: str, drop: Drop, integrator: str) -> str:
    p = drop.numbers
    if engine == "exudyn":
        return ", ".join(f"{name}={x!r}" for name, x in {"impactModel": 2, **p}.items())
    if engine == "drake":
        return _DRAKE.format(**p)
    k, b = -p["stiffness"], 0 - p["damping"]
    return _MUJOCO.format(integrator=integrator, k=k, b=b, d=IMPEDANCE)


def _case(engine: str, drop: Drop, setting: float, integrator: str, **how: Any) -> dict[str, Any]:
    """The case of `drops.py`. A setting is the number of steps in a contact, or an accuracy."""
    steps = COARSEST if setting < 1 else setting
    own = {"accuracy": setting} if setting < 1 else {}
    return {
        "snippet": _snippet(engine, drop, integrator),
        "mass": MASS,
        "velocity": SPEED,
        "radius": RADIUS,
        "duration": drop.duration,
        "steps": steps,
        "count": drop.ladder(steps)[1],
        "phase": drop.phase,
        "discrete": setting >= 1,
        **own,
        **how,
    }


def solver(drops: list[Drop], *, engine: str, integrator: str = "", **how: Any) -> Any:
    @functools.cache
    def built(setting: float) -> list[Any]:
        build = getattr(programs, engine)
        return [build(_case(engine, drop, setting, integrator, **how)) for drop in drops]

    return lambda setting: np.array([throw() for throw in built(setting)]) / SPEED


def by_mjx(drops: list[Drop], *, integrator: str) -> Any:
    """All drops at once: a vmap over what differs between their models."""
    from mujoco import mjx

    @functools.cache
    def built(steps: float) -> Any:
        cases = (_case("mujoco", drop, steps, integrator) for drop in drops)
        each = [mjx.put_model(programs.mujoco_model(case)) for case in cases]
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


SIDE = 0.2
_BOX = f"""<sdf version="1.7"><model name="ball"><link name="body">
  <inertial><mass>{MASS}</mass><inertia><ixx>0.01</ixx><ixy>0</ixy><ixz>0</ixz><iyy>0.01</iyy>
  <iyz>0</iyz><izz>0.01</izz></inertia></inertial><collision name="shape"><geometry><box>
  <size>{SIDE} {SIDE} {SIDE}</size></box></geometry></collision></link></model></sdf>"""
CORNERS = 4
"""They share the force; points are all that touches in JaxSim, and a ball would touch by one of
those that are spread over it."""


def by_jaxsim(drops: list[Drop], *, integrator: str) -> Any:
    import jaxsim.api as js
    from jaxsim.rbda.contacts import SoftContacts, SoftContactsParams

    model = js.model.JaxSimModel.build_from_model_description(
        _BOX,
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

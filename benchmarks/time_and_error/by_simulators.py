"""Exudyn, Drake and MuJoCo, by the programs of `tests/test_export/drops.py`; and MJX.

One ball over a plane, and one after another, but for MJX. Models are built once a ladder's step.
"""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from tests.test_export import drops as programs

from .rebounds import IMPEDANCE, MASS, RADIUS, SPEED, Drop

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

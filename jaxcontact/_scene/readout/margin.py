"""Measures of how far a derivative of a run can be trusted."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..._coupled.modes import Number
from ..._entry import shown
from ..._program import quick
from ..arrays.arrays import SceneArrays
from ..derivative.differentiable_run import row_matrices
from ..derivative.replay import chain_matrices, push_tangents
from ..derivative.slopes import Matrices
from ..engine.log import Log, LogNumbers, RunRecord
from ..engine.state import Rules
from ..result import Ending, nan_unless, traced
from .states import any_inside, kinematics_at

_MOST = 24
"""The largest number of directions in the bidiagonalisation."""


class Margin(eqx.Module):
    """The distance of a run from another sequence of events, and its sensitivity; scalars.

    - `time`: in s, the smallest time by which an impact preceded or followed a rival of one of its
      bodies.
    - `closing_speed`: in m/s, the smallest one of all impacts.
    - `growth`: the largest factor by which the run amplifies a small change of its start.

    A derivative holds for the sequence of events that occurred. An input change that moves an
    impact by more than `time` may change that sequence. `time` and `closing_speed` are infinite if
    there was no impact.
    """

    time: Number
    closing_speed: Number
    _record: RunRecord

    @property
    def growth(self) -> Number:
        """The largest factor by which the run amplifies a small change of its start.

        It is the largest singular value of the derivative of z(T) with respect to z(0), z = (x, T
        v). Here x are the positions of all free spheres in m, and T v their velocities times the
        duration. Flight alone has (1 + √5)/2 for any T. Each hit between spheres multiplies by
        about 2 + 2 l/(r cos φ). Here l is the path between hits, r the sum of the radii and φ the
        angle to the normal.

        Rounding is amplified alike: a run of growth G has lost log10 G digits. The value is NaN if
        the run did not complete. It is computed on access by Lanczos bidiagonalisation along the
        recorded impacts. It is exact for up to 12 position coordinates, and else a lower bound that
        is close if the growth is large. A single run compiles the matrices of its impacts,
        as a gradient does, and shares their program with it.

        Source: Golub & Kahan (1965), doi 10.1137/0702016.
        """
        return _growth(self._record)

    def __repr__(self) -> str:
        return f"Margin(time={shown(self.time)} s, closing_speed={shown(self.closing_speed)} m/s)"


def _growth(record: RunRecord) -> Array:
    """Return the growth of a run, or of each run of a batch."""
    coupled, inside, matrices = record.rules.slots > 0, record.rules.soft, None
    if not traced(record):
        # Only the parts that occurred are compiled.
        call = record.log.facts.call
        coupled = call is not None and bool(np.any(np.asarray(call.is_call)))
        inside = inside and bool(jnp.any(_each(_ends_inside, record)))
        if record.length.ndim == 0:
            record, matrices = row_matrices(record)
    if not coupled and matrices is None:
        figures, facts = record.log
        log = Log(figures._replace(coupled=None), facts._replace(call=None))
        rules = Rules(record.rules.soft, record.rules.v0, 0)
        record = dataclasses.replace(record, rules=rules, outcome=record.outcome._replace(log=log))
    return _each(_largest, record, inside, matrices)


@quick
def _each(function: Callable[..., Array], record: RunRecord, *others: Any) -> Array:
    for _ in range(record.length.ndim):
        function = eqx.filter_vmap(function)
    return function(record, *others)


def _ends_inside(record: RunRecord) -> Array:
    """Return whether bodies are in contact at the end."""
    return any_inside(record, record.length[None])


def _largest(record: RunRecord, inside: bool, matrices: Matrices | None) -> Array:
    """Return the largest singular value by Golub-Kahan bidiagonalisation. Without the `matrices` of
    its rows each row is solved again.
    """
    record = jax.tree.map(lambda x: jax.lax.stop_gradient(x) if eqx.is_array(x) else x, record)
    model, log = record.model, record.log
    end, completed = record.length, record.ending()[0] == int(Ending.COMPLETED)
    free = np.array([k for k in range(model.visible) if not model.fixed[k]], int)
    if free.size == 0:
        return nan_unless(jnp.ones_like(end), completed)

    amid = None if model.start is None else model.start.underway

    def begun(start: Array) -> SceneArrays:
        moved = {"position": start[0], "velocity": start[1] / end}
        there = {k: getattr(model, k).at[free].set(x) for k, x in moved.items()}
        there = dataclasses.replace(model, **there)
        if amid is not None:
            # A sphere within an impact at the start varies with the state before that impact.
            led = {k: getattr(amid, k).at[free].set(x) for k, x in moved.items()}
            led = amid._replace(**led)
            there = eqx.tree_at(lambda model: model.start.underway, there, led)
        return eqx.filter(there, eqx.is_inexact_array)

    def ended(floats: SceneArrays, figures: LogNumbers) -> Array:
        outcome = record.outcome._replace(log=log._replace(figures=figures))
        there = eqx.combine(floats, model)
        varied, at = dataclasses.replace(record, model=there, outcome=outcome), end[None]
        states = kinematics_at(varied, at, inside)[0]
        return jnp.stack([states.position[0, free], states.velocity[0, free] * end])

    def moved(change: Array) -> Array:
        floats, along = jax.jvp(begun, (start,), (change,))
        if matrices is None:
            rows = push_tangents(record, along)
        else:
            rows = chain_matrices(record, matrices, along)
        return jax.jvp(ended, (floats, log.figures), (along, rows))[1]

    place, speed = model.position, model.velocity
    if amid is not None:
        on = amid.counts[:, None]
        place, speed = jnp.where(on, amid.position, place), jnp.where(on, amid.velocity, speed)
    start = jnp.stack([place[free], speed[free] * end])
    # Parts that do not depend on the change are computed once.
    _, push = jax.linearize(moved, start)
    pull = jax.linear_transpose(push, start)

    def along(change: Array) -> tuple[Array, Array]:
        # The squares could overflow without the scaling.
        largest = jnp.max(jnp.abs(change))
        size = largest * jnp.linalg.norm(change / jnp.where(largest > 0, largest, 1))
        return change / jnp.where(size > 0, size, 1), size

    def step(k: Array, carry: tuple[Array, Array, Array, Array]) -> tuple[Array, ...]:
        tried, pushed, diagonal, beside = carry
        change = tried[k]
        pushed, size = along(push(change) - beside[k] * pushed)
        back = pull(pushed)[0] - size * change
        for _ in range(2):
            # Rounding reintroduces earlier directions, so they are removed again.
            back = back - jnp.tensordot(jnp.tensordot(tried, back, back.ndim), tried, 1)
        back, rest = along(back)
        tried = tried.at[k + 1].set(back)
        return tried, pushed, diagonal.at[k].set(size), beside.at[k + 1].set(rest)

    steps = min(start.size, _MOST)
    # A random direction has a component along every singular vector.
    change = along(jax.random.normal(jax.random.key(0), start.shape, start.dtype))[0]
    tried = jnp.zeros((steps + 1, *start.shape), start.dtype).at[0].set(change)
    none = jnp.zeros(steps + 1, start.dtype)
    first = (tried, jnp.zeros_like(start), none, none)
    _, _, diagonal, beside = jax.lax.fori_loop(0, steps, step, first)
    small = jnp.diag(diagonal[:steps]) + jnp.diag(beside[1:steps], 1)
    growth = jnp.linalg.svd(small, compute_uv=False)[0]
    # The derivative may overflow.
    growth = jnp.where(jnp.isfinite(growth), growth, jnp.inf)
    return nan_unless(growth, completed)

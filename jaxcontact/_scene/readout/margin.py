"""Measures of how far a derivative of a run can be trusted."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..._coupled.scalars import Number
from ..._entry import shown
from ..._program import quick
from ..derivative.replay import differentiable
from ..engine.log import Log
from ..engine.state import Rules
from ..result import Ending, nan_unless, traced
from ..run_record import RunRecord
from .states import any_inside, kinematics_at, kinematics_in_log

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
        is close if the growth is large. A run with finite-duration impacts compiles a separate
        program.

        Source: Golub & Kahan (1965), doi 10.1137/0702016.
        """
        return _growth(self._record)

    def __repr__(self) -> str:
        return f"Margin(time={shown(self.time)} s, closing_speed={shown(self.closing_speed)} m/s)"


def _growth(record: RunRecord) -> Array:
    """Return the growth of a run, or of each run of a batch."""
    coupled, inside = record.rules.members > 0, record.rules.soft
    if not traced(record):
        # Only the parts that occurred are compiled.
        coupled = record.log.facts.call is not None and bool(jnp.any(_each(_any_calls, record)))
        inside = inside and bool(jnp.any(_each(_ends_inside, record)))
    if not coupled:
        figures, facts = record.log
        log = Log(figures._replace(coupled=None), facts._replace(call=None))
        rules = Rules(record.rules.soft, record.rules.v0, 0)
        record = dataclasses.replace(record, rules=rules, outcome=record.outcome._replace(log=log))
    return _each(_largest if not inside else _largest_inside, record)


@quick
def _each(function: Callable[[RunRecord], Array], record: RunRecord) -> Array:
    for _ in range(record.length.ndim):
        function = eqx.filter_vmap(function)
    return function(record)


def _any_calls(record: RunRecord) -> Array:
    assert record.calls is not None
    return jnp.any(record.calls)


def _ends_inside(record: RunRecord) -> Array:
    """Return whether bodies are in contact at the end."""
    return any_inside(record, record.length[None])


def _largest_inside(record: RunRecord) -> Array:
    """Return `_largest` for a run in which bodies may be in contact at the end."""
    return _largest(record, inside=True)


def _largest(record: RunRecord, inside: bool = False) -> Array:
    """Return the largest singular value by Golub-Kahan bidiagonalisation."""
    record = jax.tree.map(lambda x: jax.lax.stop_gradient(x) if eqx.is_array(x) else x, record)
    layout, numbers = record.layout, record.numbers
    end, completed = record.length, record.ending()[0] == int(Ending.COMPLETED)
    free = np.array([k for k in range(layout.visible) if not layout.fixed[k]], int)
    if free.size == 0:
        return nan_unless(jnp.ones_like(end), completed)

    amid = None if numbers.start is None else numbers.start.underway

    def outcome(start: Array) -> Array:
        there = dataclasses.replace(
            numbers,
            position=numbers.position.at[free].set(start[0]),
            velocity=numbers.velocity.at[free].set(start[1] / end),
        )
        if amid is not None:
            # A sphere within an impact at the start varies with the state before that impact.
            led = amid._replace(
                position=amid.position.at[free].set(start[0]),
                velocity=amid.velocity.at[free].set(start[1] / end),
            )
            there = eqx.tree_at(lambda numbers: numbers.start.underway, there, led)
        varied = differentiable(dataclasses.replace(record, numbers=there))
        at = end[None]
        states = kinematics_at(varied, at) if inside else kinematics_in_log(varied, at)[0]
        return jnp.stack([states.position[0, free], states.velocity[0, free] * end])

    place, speed = numbers.position, numbers.velocity
    if amid is not None:
        on = amid.counts[:, None]
        place, speed = jnp.where(on, amid.position, place), jnp.where(on, amid.velocity, speed)
    start = jnp.stack([place[free], speed[free] * end])
    _, push = jax.linearize(outcome, start)
    pull = jax.linear_transpose(push, start)

    def length(change: Array) -> Array:
        # The squares could overflow without the scaling.
        largest = jnp.max(jnp.abs(change))
        safe = jnp.where(largest > 0, largest, 1)
        return safe * jnp.sqrt(jnp.sum(jnp.square(change / safe)))

    def along(change: Array) -> tuple[Array, Array]:
        size = length(change)
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

"""A run with its derivative. With concrete numbers it runs from Python. Each row of its log then
becomes a matrix, and their product carries tangents along. With traced numbers it is one program,
which is replayed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from ..._program import Found, Map, derived, outside, quick, traced
from ..arrays.arrays import SceneArrays
from ..engine.log import LogNumbers, LoopOutcome, RunRecord
from ..engine.state import Rules
from ..result import SolvedBy
from .replay import chain_matrices, push_tangents
from .slopes import Kept, Matrices, matrices

RunInputs = tuple[SceneArrays, Array, Array, Array]
"""The scene, its validity, the end time, and the tolerance."""


def differentiable_run(
    rules: Rules,
    inputs: RunInputs,
    from_python: Callable[[RunInputs], tuple[Rules, LoopOutcome]],
    at_once: Callable[[RunInputs], LoopOutcome],
) -> tuple[Rules, SceneArrays, LoopOutcome]:
    """Return the final rules of a run, the numbers of its scene, and its outcome. The numbers are
    those given. They are returned with the log, so that cotangents of both are added within the
    program that transposes the rows.
    """
    beneath = traced(inputs)

    def find(is_traced: bool, inputs: RunInputs) -> Found:
        arrays = eqx.filter(inputs[0], eqx.is_array)
        if is_traced:
            return Found((arrays, at_once(inputs)), None)
        rules, outcome = from_python(inputs)
        if beneath:
            outcome = _shorten(outcome)
        return Found((arrays, outcome), (rules, _is_by_formula(outcome)))

    def record_of(scene: RunInputs, found: Found) -> RunRecord:
        model, _, last, tolerance = scene
        ended = rules if found.choice is None else found.choice[0]
        return RunRecord(model, ended, tolerance, found.value[1], last, last)

    def changes(
        record: RunRecord, moved: SceneArrays, figures: LogNumbers
    ) -> tuple[Any, LoopOutcome]:
        still: LoopOutcome = jax.tree.map(lambda _: None, record.outcome)
        return moved, still._replace(log=still.log._replace(figures=figures))

    def slopes(scene: RunInputs, found: Found) -> Callable[[Any], Any]:
        record = record_of(scene, found)
        if traced(record.outcome.written):
            # A `vmap` over tangents alone, between two derivatives, turns everything into tracers.
            return lambda along: along_with(scene, found, along)
        chained = record, derived(_matrices, found.choice[1], record, *_kinds(record.outcome))
        data, static = eqx.partition(chained, eqx.is_array)
        leaves, structure = jax.tree.flatten(static)
        map = Map(_chain, (tuple(leaves), structure))
        like = eqx.filter(record.model, eqx.is_inexact_array), record.log.figures
        return lambda along: changes(record, *map(data, along[0], like))

    def along_with(
        scene: RunInputs, found: Found, along: RunInputs
    ) -> tuple[SceneArrays, LoopOutcome]:
        record = record_of(scene, found)
        moved = _whole(along[0], record.model)
        return changes(record, moved, _pushed(record, moved))

    found = outside(find, slopes, along_with, inputs)
    arrays, outcome = found.value
    model = eqx.combine(arrays, inputs[0])
    return rules if found.choice is None else found.choice[0], model, outcome


_pushed = eqx.filter_jit(push_tangents)


def row_matrices(record: RunRecord) -> tuple[RunRecord, Matrices]:
    """Return a single run as a gradient uses it, and the matrices of its rows."""
    outcome = _shorten(record.outcome)
    record = dataclasses.replace(record, outcome=outcome)
    return record, _matrices(None, _is_by_formula(outcome), record, *_kinds(outcome))


def _is_by_formula(outcome: LoopOutcome) -> bool:
    way = np.asarray(outcome.log.figures.outcome.solved_by)[: int(outcome.written)]
    return not np.any(way == SolvedBy.RADIAL)


def _shorten(outcome: LoopOutcome) -> LoopOutcome:
    """Return the outcome of a short run with fewer blank rows; a derivative visits all rows."""
    if int(outcome.written) > _FEW_ROWS:
        return outcome
    log = jax.tree.map(lambda x: np.asarray(x)[:_FEW_ROWS], outcome.log)
    return outcome._replace(log=jax.device_put(log))


_FEW_ROWS = 32
"""The number of rows with which short runs share the programs of their derivatives."""


def _kinds(outcome: LoopOutcome) -> tuple[Kept | None, Kept | None, Int[Array, " K"]]:
    """Return the rows of each kind, and the place of each row among its kind."""
    facts = outcome.log.facts
    rows, written = facts.tied.shape[0], int(outcome.written)
    is_call = np.zeros(rows, bool) if facts.call is None else np.asarray(facts.call.is_call)
    is_call, number = is_call[:written], np.arange(written)
    slot = np.zeros(rows, int)

    def keep(which: np.ndarray) -> Kept | None:
        rows_of_kind = number[which]
        slot[rows_of_kind] = np.arange(rows_of_kind.size)
        if rows_of_kind.size == 0:
            return None
        room = max(8, 1 << int(rows_of_kind.size - 1).bit_length())
        row = np.zeros(room, int)
        row[: rows_of_kind.size] = rows_of_kind
        return Kept(jax.device_put(row), jax.device_put(np.arange(room) < rows_of_kind.size))

    hits, calls = keep(~is_call), keep(is_call)
    return hits, calls, jax.device_put(slot)


@quick
def _matrices(choice: None, by_formula: bool, *inputs: Any) -> Matrices:
    return matrices(*inputs, by_formula=by_formula)


def _chain(static: Any, data: Any, along: SceneArrays) -> tuple[SceneArrays, LogNumbers]:
    leaves, structure = static
    record, matrices = eqx.combine(data, jax.tree.unflatten(structure, leaves))
    along = _whole(along, record.model)
    return along, chain_matrices(record, matrices, along)


def _whole(along: SceneArrays, model: SceneArrays) -> SceneArrays:
    """Return tangents with zeros in place of None."""
    floats = eqx.filter(model, eqx.is_inexact_array)
    return eqx.combine(along, jax.tree.map(jnp.zeros_like, floats))

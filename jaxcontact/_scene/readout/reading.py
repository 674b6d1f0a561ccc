"""The results of a run, read from its log: status, states at given times, impacts and work."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..._program import derived, quick
from ..course import Course
from ..result import Impacts, Moment, traced
from .impact_table import table_of
from .states import moment, moment_at, moment_in_log, told, told_in_log
from .straddling import booked
from .wall_work import work_of


class Reading(NamedTuple):
    """The contents of a `Run`; `total` is the number of impacts."""

    status: Int[Array, ""]
    reached: Float[Array, ""]
    now: Moment
    impacts: Impacts
    nearest: tuple[Array, Array]
    total: Int[Array, ""]
    work: Float[Array, ""]


def read(course: Course, asked: Float[Array, " T"], rows: int | None) -> Reading:
    """Return the results, with the table of impacts padded to so many `rows`. With concrete numbers
    the table has no blank rows. Motion inside contacts is compiled only if one of the times needs
    it.
    """
    reading = derived(_by_choice, course, asked, rows, decide=_from_log)
    if traced(reading.total):
        return reading
    total = int(reading.total)
    if not traced(reading.impacts):
        whole = jax.tree.map(lambda x: np.asarray(x)[:total], reading.impacts)
        return reading._replace(impacts=jax.device_put(whole))
    return reading._replace(impacts=_first(reading.impacts, total))


@eqx.filter_jit
def _first(impacts: Impacts, total: int) -> Impacts:
    return jax.tree.map(lambda column: column[:total], impacts)


def _from_log(course: Course, asked: Array, rows: int | None) -> tuple[Reading, tuple[bool, bool]]:
    """Return the results from Python, with two flags for `_by_choice`. They say whether a requested
    time, and whether an end of the run, is inside a contact.
    """
    count, length = asked.shape[0], np.asarray(course.length)
    ends = np.stack([np.zeros_like(length), length])
    every, inside = told_in_log(course, np.concatenate([np.asarray(asked), ends]))
    inside, cut = bool(np.any(inside[:count])), bool(np.any(inside[count:]))
    now = told(course, asked) if inside else jax.tree.map(lambda x: x[:count], every)
    if cut:
        course = booked(course, jax.device_put(told(course, ends)))
    return _tabled(course)._replace(now=jax.device_put(now)), (inside, cut)


def _by_choice(
    choice: tuple[bool, bool] | None, course: Course, asked: Array, rows: int | None
) -> Reading:
    """Return the results from one program with the parts chosen, or with all parts."""
    if choice is not None:
        inside, cut = choice
        now = moment(course, asked) if inside else moment_in_log(course, asked)[0]
        return _told(booked(course, moment_at(course, course.ends)) if cut else course, now, None)
    if not course.rules.soft:
        return _told(course, moment_at(course, asked), rows)
    # One program for all times.
    every, count = moment_at(course, jnp.concatenate([asked, course.ends])), asked.shape[0]
    now, there = (
        jax.tree.map(lambda x, k=k: x[k], every) for k in (slice(count), slice(count, None))
    )
    return _told(booked(course, there), now, rows)


def _told(course: Course, now: Any, rows: int | None) -> Reading:
    status, reached = course.ending()
    impacts, nearest, total = table_of(course, status, rows)
    return Reading(status, reached, now, impacts, nearest, total, work_of(course, status, reached))


@quick
def _tabled(course: Course) -> Reading:
    """Return everything but the states."""
    return _told(course, None, None)

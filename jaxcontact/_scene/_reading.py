"""What a run tells, read from its log: how it ended, states at some times, impacts and work."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._program import derived, quick
from ._log import Log
from ._partly import booked
from ._progress import CROWDED, NOT_CONVERGED, OVER, RUNNING, TWO_SUPPORTS, Rules
from ._result import Ending, Impacts, Moment, traced
from ._run import moment, moment_at, moment_in_log
from ._system import Layout, Numbers
from ._table import table_of
from ._work import work_of


class Course(NamedTuple):
    """A run as it was searched: its `log`, with `written` rows, what was the `status` of the search
    at its end, and the time `now` there; whether there is `more` to come.

    The run was `valid`, went until `last`, and was to last for `length`.
    """

    log: Log
    written: Int[Array, ""]
    status: Array
    now: Array
    more: Array
    valid: Array
    last: Array
    length: Array


class Reading(NamedTuple):
    """What a `Run` is made of; how many `total` impacts there are."""

    status: Int[Array, ""]
    reached: Float[Array, ""]
    now: Moment
    impacts: Impacts
    nearest: tuple[Array, Array]
    total: Int[Array, ""]
    work: Float[Array, ""]


def read(
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    course: Course,
    asked: Float[Array, " T"],
    tolerance: Float[Array, ""],
    rows: int | None,
) -> Reading:
    """All of it, with the table of impacts padded to so many `rows`.

    Of numbers that are concrete it has no more rows than there are impacts, and motion inside of
    contacts is compiled only where a time is inside of one.
    """
    given = (layout, numbers, rules, course, asked, tolerance, rows)
    reading = derived(_by_choice, *given, decide=_from_log)
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


def _from_log(
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    course: Course,
    asked: Array,
    tolerance: Array,
    rows: int | None,
) -> tuple[Reading, tuple[bool, bool]]:
    """As from Python; whether a time, and whether an end of the run, is inside of a contact."""
    given = (layout, numbers, rules)
    reading, inside, cut = _read(*given, course, asked)
    if bool(inside):
        now = moment(*given, course.log, course.written, reading.reached, asked, tolerance)
        reading = reading._replace(now=now)
    if bool(cut):
        log = _booked(*given, course, reading.reached, tolerance)
        reading = _tabled(*given, course._replace(log=log), reading.status, reading.now)
    return reading, (bool(inside), bool(cut))


def _by_choice(
    choice: tuple[bool, bool] | None,
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    course: Course,
    asked: Array,
    tolerance: Array,
    rows: int | None,
) -> Reading:
    """As one program, which has what was chosen, or all that may be needed."""
    given = (layout, numbers, rules)
    status, reached = _ending(course)
    told = (course.log, course.written, reached)
    if choice is not None:
        inside, cut = choice
        told = (*given, *told, asked)
        now = moment(*told, tolerance) if inside else moment_in_log(*told)[0]
        log = _booked(*given, course, reached, tolerance) if cut else course.log
        return _told(*given, course._replace(log=log), status, now, None)
    if not rules.soft:
        return _told(*given, course, status, moment_at(*given, *told, asked, tolerance), rows)
    ends = jnp.stack([jnp.zeros_like(course.length), course.length])
    # One program for all times.
    every = moment_at(*given, *told, jnp.concatenate([asked, ends]), tolerance)
    count = asked.shape[0]
    now, there = (
        jax.tree.map(lambda x, cut=cut: x[cut], every) for cut in (slice(count), slice(count, None))
    )
    log = booked(layout, numbers, *told[:2], there, reached)
    return _told(*given, course._replace(log=log), status, now, rows)


def _booked(
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    course: Course,
    reached: Array,
    tolerance: Array,
) -> Log:
    ends = jnp.stack([jnp.zeros_like(course.length), course.length])
    told = (course.log, course.written, reached)
    there = moment_at(layout, numbers, rules, *told, ends, tolerance)
    return booked(layout, numbers, *told[:2], there, reached)


@quick
def _read(
    layout: Layout, numbers: Numbers, rules: Rules, course: Course, asked: Float[Array, " T"]
) -> tuple[Reading, Array, Array]:
    """The reading from the log alone; whether a time, or an end of the run, is inside of a contact
    that is on there.
    """
    status, reached = _ending(course)
    ends = jnp.stack([jnp.zeros_like(course.length), course.length])
    times, count = jnp.concatenate([asked, ends]), asked.shape[0]
    every, inside = moment_in_log(layout, numbers, rules, *course[:2], reached, times)
    now = jax.tree.map(lambda x: x[:count], every)
    reading = _told(layout, numbers, rules, course, status, now, None)
    return reading, jnp.any(inside[:count]), jnp.any(inside[count:])


@quick
def _tabled(
    layout: Layout, numbers: Numbers, rules: Rules, course: Course, status: Array, now: Moment
) -> Reading:
    return _told(layout, numbers, rules, course, status, now, None)


def _told(
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    course: Course,
    status: Int[Array, ""],
    now: Moment,
    rows: int | None,
) -> Reading:
    log, written, reached = course.log, course.written, _ending(course)[1]
    impacts, nearest, total = table_of(layout, numbers, log, written, status, rows)
    work = work_of(layout, numbers, log, written, status, reached, rules.soft)
    return Reading(status, reached, now, impacts, nearest, total, work)


def _ending(course: Course) -> tuple[Int[Array, ""], Float[Array, ""]]:
    """How a run ended, and up to which time its values hold."""
    # A run may end while bodies are in contact.
    searched, valid = course.status, course.valid
    stuck = (searched != RUNNING) & (searched != OVER)
    more = course.more & (searched != OVER)
    status = jnp.where(stuck, int(Ending.ACCUMULATED), int(Ending.COMPLETED))
    crowded = (searched == CROWDED) | (searched == TWO_SUPPORTS)
    status = jnp.where(crowded, int(Ending.CROWDED), status)
    status = jnp.where(searched == NOT_CONVERGED, int(Ending.NOT_CONVERGED), status)
    status = jnp.where(~stuck & more, int(Ending.TOO_MANY_IMPACTS), status)
    status = jnp.where(valid, status, int(Ending.INVALID_INPUT))
    reached = jnp.where(stuck, course.now, jnp.where(more | ~valid, -1, course.last))
    abrupt = (course.last < course.length) & (status == int(Ending.COMPLETED))
    status = jnp.where(abrupt, int(Ending.WALL_TOO_ABRUPT), status)
    return status, jax.lax.stop_gradient(reached)

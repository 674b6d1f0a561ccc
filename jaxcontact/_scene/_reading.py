"""What a run tells, read from its log: how it ended, states at some times, impacts and work."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._program import quick
from ._log import Log
from ._outside import derived
from ._partly import booked
from ._progress import CROWDED, NOT_CONVERGED, OVER, RUNNING, TWO_SUPPORTS, Rules
from ._result import Ending, Impacts, Moment, traced
from ._run import inside_of_any, moment, moment_at, moment_in_log
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

    Outside of a program one reads the log alone; motion inside of contacts is compiled only where a
    time is inside of one.
    """
    given = (layout, numbers, rules)
    if not traced((numbers, course, asked)):
        reading, inside, cut = _read(*given, course, asked)
        if bool(inside):
            now = moment(*given, course.log, course.written, reading.reached, asked, tolerance)
            reading = reading._replace(now=now)
        if bool(cut):
            ends = jax.device_put(np.stack([np.zeros_like(course.length), course.length]))
            told = (course.log, course.written, reading.reached)
            ends = moment_at(*given, *told, ends, tolerance)
            log = booked(layout, numbers, *told[:2], ends, reading.reached)
            reading = _tabled(*given, course._replace(log=log), reading.status, reading.now)
        total = int(reading.total)
        whole = jax.tree.map(lambda x: np.asarray(x)[:total], reading.impacts)
        return reading._replace(impacts=jax.device_put(whole))
    reading = derived(_of_choice, *given, course, asked, tolerance, rows, choose=_inside)
    if rows is not None:
        return reading
    total = int(reading.total)
    return reading._replace(impacts=jax.tree.map(lambda x: x[:total], reading.impacts))


def _inside(
    layout: Layout, numbers: Numbers, rules: Rules, course: Course, asked: Array, *given: Any
) -> tuple[bool, bool]:
    """Whether a time is inside of a contact, and an end of the run."""
    if not rules.soft:
        return False, False
    given = (layout, numbers, course.log, course.written)
    return bool(inside_of_any(*given, asked)), bool(inside_of_any(*given, _ends(course)))


@quick
def _of_choice(
    choice: tuple[bool, bool] | None,
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    course: Course,
    asked: Float[Array, " T"],
    tolerance: Float[Array, ""],
    rows: int | None,
) -> Reading:
    """A reading with a derivative. All times are looked up by one program."""
    inside, cut = (rules.soft, rules.soft) if choice is None else choice
    status, reached = _ending(course)
    told, log = (course.log, course.written, reached), course.log
    times, count = jnp.concatenate([asked, _ends(course)]) if cut else asked, asked.shape[0]
    given = (layout, numbers, rules, *told, times)
    every = moment(*given, tolerance) if inside or cut else moment_in_log(*given)[0]
    if cut:
        there = jax.tree.map(lambda x: x[count:], every)
        log = booked(layout, numbers, *told[:2], there, reached)
    now = jax.tree.map(lambda x: x[:count], every)
    return _told(layout, numbers, rules, course._replace(log=log), status, now, rows)


def _ends(course: Course) -> Float[Array, "2"]:
    return jnp.stack([jnp.zeros_like(course.length), course.length])


@quick
def _read(
    layout: Layout, numbers: Numbers, rules: Rules, course: Course, asked: Float[Array, " T"]
) -> tuple[Reading, Array, Array]:
    """The reading from the log alone; whether a time, or an end of the run, is inside of a contact
    that is on there.
    """
    status, reached = _ending(course)
    times, count = jnp.concatenate([asked, _ends(course)]), asked.shape[0]
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

"""Columns of a table of oblique impacts: speeds, angles and spins by their headings."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from ..._flight import Floats
from ..recordings.table_columns import read_columns
from ..tables.fault import RecordingError

OUTCOMES = "tangential_restitution", "tangential_rebound", "rebound_angle", "rebound_spin"
BEFORE = "angle", "speed", "normal_velocity", "tangential_velocity"
_NAMES = (*BEFORE, *OUTCOMES, "e", "ball")


@dataclasses.dataclass(frozen=True)
class ObliqueTable:
    """Oblique impacts in SI units, all columns (n,): the `normal` and `tangential` speeds before
    them, and the measured `outcomes` by the names of `fit_oblique`, NaN for missing readings.

    `restitution` is the median of the column of e, None without one. `source` and `notes` are those
    of `TableColumns`.
    """

    source: str
    notes: tuple[str, ...]
    normal: Floats
    tangential: Floats
    outcomes: dict[str, Any]
    restitution: float | None


def is_oblique(source: Any, **how: Any) -> bool:
    """Return whether a table has headings of oblique impacts: a direction before and an outcome."""
    try:
        there = read_columns(source, _NAMES, needed=(), every_ball=True, **how)
    except (RecordingError, ValueError, OSError):
        return False
    directed = there.values.keys() & {"angle", "tangential_velocity"}
    return bool(directed) and bool(there.values.keys() & set(OUTCOMES))


def read_rebounds(source: Any, **how: Any) -> ObliqueTable:
    """Read a table of oblique impacts; `how` as in `read_columns`.

    Raises RecordingError and ValueError as that does, and for missing columns.
    """
    read = read_columns(source, _NAMES, needed=(), **how)
    there = dict(read.values)
    normal, tangential = _speeds(read.source, there)
    outcomes: dict[str, Any] = {name: there[name] for name in OUTCOMES if name in there}
    if "tangential_rebound" in outcomes:
        after = outcomes.pop("tangential_rebound")
        if "tangential_restitution" not in outcomes:
            with np.errstate(divide="ignore", invalid="ignore"):
                outcomes["tangential_restitution"] = np.where(
                    tangential > 0, after / tangential, np.nan
                )
    if not outcomes:
        problem = (
            "has no outcome of oblique impacts; one of the columns tangential_restitution "
            "(v_t'/v_t), tangential_rebound (v_t'), rebound_angle or rebound_spin is needed"
        )
        raise RecordingError(problem, read.source, None)
    e = there.get("e")
    known = None if e is None or np.isnan(e).all() else float(np.nanmedian(e))
    return ObliqueTable(read.source, read.notes, normal, tangential, outcomes, known)


def _speeds(source: str, there: dict[str, Floats]) -> tuple[Floats, Floats]:
    """Return the normal and the tangential speed from those columns that a table has."""
    angle = there.get("angle")
    if angle is not None and (np.abs(angle) >= np.pi / 2).any():
        row = int(np.argmax(np.abs(angle) >= np.pi / 2))
        problem = (
            f"holds an angle of impact of {np.degrees(angle[row]):.3g} degrees; angles are those "
            "from the normal, below 90 degrees"
        )
        raise RecordingError(problem, source, None, "angle")
    match there:
        case {"normal_velocity": normal, "tangential_velocity": tangential}:
            return normal, np.abs(tangential)
        case {"angle": angle, "speed": speed}:
            return speed * np.cos(angle), speed * np.abs(np.sin(angle))
        case {"angle": angle, "normal_velocity": normal}:
            return normal, normal * np.abs(np.tan(angle))
        case {"speed": speed, "tangential_velocity": tangential}:
            beyond = np.abs(tangential) >= speed
            if not beyond.any():
                return np.sqrt(speed**2 - tangential**2), np.abs(tangential)
            problem = (
                "holds tangential speeds above the speed; name the normal speed in its heading"
            )
            raise RecordingError(problem, source, None, "speed")
    problem = (
        "does not say how bodies come in; the columns angle and speed, or "
        "normal_velocity and tangential_velocity, are needed"
    )
    raise RecordingError(problem, source, None)

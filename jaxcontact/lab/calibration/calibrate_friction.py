"""The friction law that describes a table of oblique impacts, and the columns of such a table."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from ... import AbstractFriction, Contact, ExactRestitution, RoundBodies
from ...extend import RESTITUTION, Floats, require_kind, require_number
from ..oblique.choose_friction import FrictionChoice, choose_friction
from ..recordings import RecordingError
from ..recordings.table_columns import read_columns

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
    """Read a table of oblique impacts; `how` as in `read_columns`, which may raise."""
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


@dataclasses.dataclass(frozen=True, repr=False)
class FrictionCalibration:
    """Result of `calibrate_friction`; prints μ with its error, the law, and what to measure next.

    `choice` holds all fits (see `choose_friction`). `restitution` is the e of the normal motion.
    `source` is the origin of the table, and `notes` say how it was read.
    """

    choice: FrictionChoice
    restitution: float
    source: str
    notes: tuple[str, ...]

    @property
    def friction(self) -> AbstractFriction | None:
        """The fitted friction law; None if no fit converged."""
        return None if self.choice.best is None else self.choice.friction()

    @property
    def converged(self) -> bool:
        """True if every fit converged."""
        return all(fit.converged for fit in self.choice.fits.values())

    def to_json(self) -> str:
        """Return the numbers of all fits as JSON."""
        laws = {
            name: {
                "law": type(fit.params).__name__,
                "parameters": dict(zip(fit.names, fit.values.tolist(), strict=True)),
                "standard_errors": {
                    key: None if error != error else error
                    for key, error in fit.standard_errors.items()
                },
                "converged": bool(fit.converged),
                "adequate": fit.adequate,
            }
            for name, fit in self.choice.fits.items()
        }
        content = {
            "source": self.source,
            "restitution": self.restitution,
            "best": self.choice.best,
            "rivals": list(self.choice.rivals),
            "verdict": self.choice.verdict,
            "laws": laws,
        }
        return json.dumps(content, indent=1, ensure_ascii=False) + "\n"

    def __repr__(self) -> str:
        read = f"; read as {'; '.join(self.notes)}" if self.notes else ""
        return f"{self.choice}\n{self.source}, e = {self.restitution:.4g}{read}"


def calibrate_friction(
    source: Any,
    *,
    restitution: float | None = None,
    tangential_ratio: ArrayLike | None = None,
    radius: float | None = None,
    shape: str = "sphere",
    friction: Mapping[str, AbstractFriction] | None = None,
    columns: str | Mapping[str, int | str] | None = None,
    decimal: str | None = None,
    ball: str | None = None,
    sheet: str | int | None = None,
    progress: bool | Callable[[str], None] | None = None,
) -> FrictionCalibration:
    """Fit friction laws to a table of oblique impacts, and choose one (see `choose_friction`).

    Columns are recognised by meaning, units in headings are converted:

    - before the impact `angle` from the normal and `speed`; or `normal_velocity` and
      `tangential_velocity`;
    - after it at least one of `tangential_restitution` v_t'/v_t, `tangential_rebound` v_t',
      `rebound_angle` and `rebound_spin`, positive in the sense of rolling; empty cells are missing
      readings;
    - `e`, the restitution of the normal speeds, whose median is used.

    Arguments: `source`, `columns`, `decimal`, `ball` and `sheet` as in `read_recording`.
    `restitution`: e, if the table has no such column. `tangential_ratio`: κ, 2(1-ν)/(2-ν) for like
    materials; without it κ is fitted. `radius` in m, needed for spins. `shape` of the body:
    "sphere", "shell" or "disc". `friction` and `progress` as in `choose_friction`.

    Returns a `FrictionCalibration`. Raises RecordingError for a table that cannot be read, and
    ValueError for a missing e or radius and for numbers out of range.
    """
    if ball is not None:
        require_kind("ball", ball, str, "the name of a ball or None")
    how = {"columns": columns, "decimal": decimal, "ball": ball, "sheet": sheet}
    table = read_rebounds(source, **how)
    e = table.restitution if restitution is None else restitution
    if e is None:
        raise ValueError(
            f"Argument `restitution` must be given, as {table.source} has no column of e (the "
            "normal speed after over before), but is None."
        )
    # Noise may raise a measured median above 1.
    e = require_number("restitution", min(e, 1.0) if restitution is None else e, RESTITUTION)
    if radius is None and "rebound_spin" in table.outcomes:
        raise ValueError(
            f"Argument `radius` must be given in m, as {table.source} holds spins, but is None."
        )
    bodies = shape if radius is None else RoundBodies(radius, shape=shape)  # pyright: ignore[reportArgumentType]
    with jax.enable_x64(True):
        # The outcome depends on neither mass nor stiffness.
        contact = Contact(1.0, 1.0, tangential_ratio=tangential_ratio)
        choice = choose_friction(
            ExactRestitution(jnp.asarray(e)),
            contact,
            table.normal,
            table.tangential,
            friction=friction,
            bodies=bodies,
            progress=progress,
            **table.outcomes,
        )
    return FrictionCalibration(choice, e, table.source, table.notes)

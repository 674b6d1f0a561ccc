"""The result of an export."""

from __future__ import annotations

import dataclasses
import math

import jax
import numpy as np
from jaxtyping import Float

from .. import AbstractLaw, Contact, restitution
from ..extend import POSITIVE, quantity, require_number, text_table
from .at_time_step import TimeStepRestitution, restitution_in_steps
from .engine import Draft

_STEPPED = "'drake', 'lammps', 'mercurydpm' (without plasticity), 'mujoco', 'newton'"
"""The engines whose scheme is known."""

_DECADES, _EACH = 2, 20
"""Decades examined on both sides of a speed, and speeds per decade."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Export(Draft):
    """The parameters with which an engine delivers a wanted restitution.

    `engine` and `model` name the place of the parameters. `parameters` holds the numbers and
    `units` their units, by the same names; `snippet` is the text to paste. `velocity` is the
    closing speed in m/s, or several (n,). `target` is the wanted restitution and `delivered` that
    of the engine's law with these parameters, both by `impact`. They are equal at one speed, and as
    close as one set of parameters allows at several.

    `law` and `contact` are the engine's law as solved: `impact(law, contact, velocity)` gives all
    other results. `duration` in s is that of this contact. `time_step` in s is a step at which the
    engine itself was measured, `steps` of them per contact. Its error there was within
    `expected_error` (relative, of the restitution, for e of 0.12 and more). These three are None if
    the engine was not run.

    `scheme` is the engine's time stepping, or None if unknown; `at_time_step` returns e at another
    step. `limit` states in words where the parameters do not hold, `source` the reference of the
    engine's formula.
    """

    engine: str
    velocity: float | Float[np.ndarray, " n"]
    target: float | Float[np.ndarray, " n"]
    delivered: float | Float[np.ndarray, " n"]
    duration: float
    _wanted: tuple[AbstractLaw, Contact]

    @property
    def error(self) -> float | Float[np.ndarray, " n"]:
        """Error of the engine's e, engine minus wanted, at every speed."""
        return self.delivered - self.target

    def holds(self, within: float = 0.01) -> SpeedRange:
        """Return the closing speeds at which the engine's e lies within `within` of the law's.

        The `SpeedRange` also gives the error outside this range. Raises ValueError for a `within`
        that is not positive.
        """
        made = self.law, self.contact
        speeds = np.atleast_1d(self.velocity)
        return speed_range(*self._wanted, made, speeds, within)

    def at_time_step(self, time_step: float, within: float = 0.01) -> TimeStepRestitution:
        """Return the engine's e at a time step in s that is not short compared with the contact.

        The engine's scheme is run for all positions of the touch within a step. Returns a
        `TimeStepRestitution` with the smallest and the largest e. It also gives the contact
        duration, reached with a softer contact or shorter steps, at which e stays `within` the
        target. Raises ValueError for several speeds, numbers that are not positive, and an engine
        with unknown scheme.
        """
        time_step = require_number("time_step", time_step, POSITIVE)
        within = require_number("within", within, POSITIVE)
        if self.scheme is None:
            known = "it was not run"
            if self.time_step is not None:
                known = f"its error is known at steps of {self.time_step:.3g} s only (`time_step`)"
            raise ValueError(
                f"Argument `engine` must be one of {_STEPPED} for a time step, but is "
                f"{self.engine!r} with {self.model}, whose scheme is not reproduced; {known}."
            )
        if np.ndim(self.velocity) > 0:
            raise ValueError(
                "Argument `velocity` must be one speed for a time step, but there are "
                f"{np.size(self.velocity)}."
            )
        return restitution_in_steps(
            self.law,
            self.contact,
            float(self.velocity),
            target=float(self.target),
            duration=self.duration,
            scheme=self.scheme,
            time_step=time_step,
            within=within,
        )

    @property
    def time_step(self) -> float | None:
        """Time step in s at which the engine was measured; None if it was not run."""
        return None if self.steps is None else self.duration / self.steps

    def __repr__(self) -> str:
        rows = [(name, f"{x:.9g} {self.units[name]}") for name, x in self.parameters.items()]
        several = np.ndim(self.velocity) > 0
        for name in ("target", "delivered", "duration", "time_step", "expected_error"):
            if several and name in ("target", "delivered"):
                continue
            if (x := getattr(self, name)) is not None:
                more = ", or less" if name == "time_step" else ""
                rows.append((name, quantity(name, f"{x:.9g}") + more))
        return "\n".join(
            [
                f"Export to {self.engine}: {self.model}",
                *text_table(rows, indent=2),
                *self.by_speed(),
                *(f"  | {line}" for line in self.snippet.splitlines()),
                f"  limit: {self.limit}",
                f"  source: {self.source}",
            ]
        )

    def by_speed(self) -> list[str]:
        """Return the wanted e and the engine's at every speed, as lines; empty for one speed."""
        if np.ndim(self.velocity) == 0:
            return []
        columns = (np.atleast_1d(x) for x in (self.velocity, self.target, self.delivered))
        rows = [
            (f"{v:.4g}", f"{wanted:.4f}", f"{e:.4f}", signed_text(e - wanted))
            for v, wanted, e in zip(*columns, strict=True)
        ]
        head = ("v (m/s)", "wanted e", "engine's e", "error")
        largest = float(np.max(np.abs(self.error)))
        return [
            f"  largest error of e {largest:.2g}, the least that one set of parameters can have:",
            *text_table(rows, header=head, align=">>>>", indent=4),
        ]


@dataclasses.dataclass(frozen=True)
class SpeedRange:
    """The speeds from `low` to `high` in m/s, around those of an export, at which it holds.

    In this range the engine's e lies within `within` of the law's. `low` is 0 if the export holds
    down to a hundredth of the speed, `high` infinite if it holds up to a hundred times the speed.
    Both are NaN if it does not hold at the speed itself, the geometric mean of several.

    `velocity` (m,) in m/s holds the examined speeds, `target` (m,) the law's e and `delivered` (m,)
    the engine's; NaN where an impact could not be solved.
    """

    low: float
    high: float
    within: float
    velocity: Float[np.ndarray, " m"]
    target: Float[np.ndarray, " m"]
    delivered: Float[np.ndarray, " m"]

    @property
    def error(self) -> Float[np.ndarray, " m"]:
        """Error of the engine's e relative to the law's, engine minus law (m,)."""
        return self.delivered - self.target

    def __repr__(self) -> str:
        slowest, middle, fastest = self.velocity[[0, len(self.velocity) // 2, -1]]
        low = f"{slowest:.3g} (and slower)" if self.low == 0 else f"{self.low:.3g}"
        high = (
            f"{fastest:.3g} m/s (and faster)" if self.high == math.inf else f"{self.high:.3g} m/s"
        )
        shown, known = range(0, len(self.velocity), _EACH // 2), np.isfinite(self.error)
        rows = [
            (
                f"{self.velocity[k]:.3g}",
                *(f"{e[k]:.4f}" if known[k] else "-" for e in (self.target, self.delivered)),
                signed_text(self.error[k]) if known[k] else "-, could not be solved",
            )
            for k in shown
        ]
        head = ("v (m/s)", "law's e", "engine's e", "error")
        where = f"from {low} to {high}"
        if math.isnan(self.low):
            where = f"at no speed around {middle:.3g} m/s, that of the export"
        return "\n".join(
            [
                f"e is within {self.within:g} of the law's {where}",
                *text_table(rows, header=head, align=">>>>", indent=2),
            ]
        )


def signed_text(error: float) -> str:
    """Return an error of e as text with its sign; zero is always +0.0000."""
    return f"{round(float(error), 4) + 0.0:+.4f}"


def speed_range(
    law: AbstractLaw,
    contact: Contact,
    made: tuple[AbstractLaw, Contact],
    speeds: Float[np.ndarray, " n"],
    within: float,
) -> SpeedRange:
    """Return the speeds in m/s at which the e of a law and of the engine's law `made` agree."""
    within = require_number("within", within, POSITIVE)
    middle = math.sqrt(float(speeds.min()) * float(speeds.max()))
    grid = middle * np.logspace(-_DECADES, _DECADES, 2 * _DECADES * _EACH + 1)
    with jax.enable_x64(True):
        target, delivered = (
            np.asarray(restitution(model, at, grid)) for model, at in ((law, contact), made)
        )
    # NaN counts as outside.
    close = np.abs(delivered - target) <= within
    at = int(np.argmin(np.abs(np.log(grid / middle))))
    if not close[at]:
        return SpeedRange(math.nan, math.nan, within, grid, target, delivered)
    first = at - int(np.argmin(close[at::-1])) if not close[: at + 1].all() else -1
    last = at + int(np.argmin(close[at:])) if not close[at:].all() else len(grid)
    difference = np.abs(delivered - target) - within
    return SpeedRange(
        0.0 if first < 0 else _crossing(grid, difference, first, first + 1),
        math.inf if last == len(grid) else _crossing(grid, difference, last, last - 1),
        within,
        grid,
        target,
        delivered,
    )


def _crossing(
    grid: Float[np.ndarray, " m"], difference: Float[np.ndarray, " m"], bad: int, inside: int
) -> float:
    """Return the zero of a difference between two speeds, by linear interpolation in ln v."""
    if not np.isfinite(difference[bad]):
        return float(grid[inside])
    share = difference[inside] / (difference[inside] - difference[bad])
    return float(grid[inside] * (grid[bad] / grid[inside]) ** share)

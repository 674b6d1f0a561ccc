"""The range of speeds in which an export holds, and its error elsewhere."""

from __future__ import annotations

import dataclasses
import math

import jax
import numpy as np
from jaxtyping import Float

from .._contact import Contact
from .._entry import POSITIVE, require_number
from .._impact import restitution
from .._laws import AbstractLaw
from .._text.table import text_table

_DECADES, _EACH = 2, 20
"""Decades examined on both sides of a speed, and speeds per decade."""


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

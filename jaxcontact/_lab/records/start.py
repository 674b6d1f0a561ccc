"""Locating the contact in a record: a start for its fit, and a check of the result."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Container
from typing import Any, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..._fit import Fit
from ..._laws import AbstractHuntCrossley

Column = Float[np.ndarray, " n"]
Model = TypeVar("Model", bound=Any)

_TOUCHED = 0.05
"""Fraction of the largest reading above which contact is assumed, as a start for the touch."""

_QUIET = 5
"""Least number of readings for the level without contact."""

_HALF = 0.6
"""Fraction of a contact during which force or indentation exceeds half of its maximum.

It ranges from .57 for a Hertz force to .67 for the sine of a linear spring.
"""

_FAR = 3.0
"""Factor beyond which a duration is no usable start: the two contacts would hardly overlap."""

_DAMPING = 0.01, 3.0
"""Range of damping factors α that show in a record and leave a measurable rebound."""

_SEEN = 0.5
"""Least fraction of the non-noise scatter of a column that a fit must describe.

Contacts that lie beside the one of the record describe almost nothing of it.
"""


def level_in(reading: Column) -> float:
    """Return the level of a force without contact: the median of the quiet readings before it.

    Without such readings it is the median of those after it, or else the least reading.
    """
    top, half = int(np.argmax(reading)), (reading.max() + np.median(reading)) / 2
    width, below = int(np.count_nonzero(reading > half)), np.flatnonzero(reading <= half)
    # From touch to half of the peak a force takes less time than it stays above that.
    before = reading[: max(int(below[below < top].max(initial=0)) - width, 0)]
    after = reading[int(below[below > top].min(initial=reading.size)) + 2 * width :]
    quiet = next((one for one in (before, after) if one.size >= _QUIET), reading.min())
    return float(np.median(quiet))


def touch_in(time: Column, reading: Column) -> float:
    """Return the approximate time in s at which a reading without its level begins to rise.

    It is searched back from the peak: noise before the contact has peaks of its own.
    """
    top = int(np.argmax(reading))
    below = np.flatnonzero(reading[: top + 1] <= _TOUCHED * reading[top])
    return float(time[below[-1] if below.size else 0])


def near(
    start: Model, time: Column, reading: Column, held: Container[str], far: float = _FAR
) -> Model:
    """Return the start with a stiffness that gives about the contact duration of the record.

    Numbers that are `held`, by their full names, stay, and so does a stiffness whose contact is not
    longer or shorter by a factor of `far`. `reading` is without the level before the contact.

    Without damping `T = 2√π/(n+1) Γ(1/(n+1))/Γ(1/(n+1) + 1/2) ((n+1) m/(2 K v^(n-1)))^(1/(n+1))`.
    """
    contact, speed = start.contact, float(start.velocity)
    mass, stiffness, n = (float(getattr(contact, f)) for f in ("mass", "stiffness", "exponent"))
    width = np.sum(np.gradient(time)[reading > reading.max() / 2]) if time.size > 1 else 0.0
    duration, part = float(width) / _HALF, 1 / (n + 1)
    if "contact.stiffness" in held or not (reading.max() > 0 and 0 < duration < math.inf):
        return start
    whole = 2 * math.sqrt(math.pi) * part * math.gamma(part) / math.gamma(part + 0.5)
    better = mass / (2 * part * speed ** (n - 1)) * (whole / duration) ** (n + 1)
    if abs(math.log(better / stiffness)) <= (n + 1) * math.log(far):
        return start
    start = eqx.tree_at(lambda s: s.contact.stiffness, start, jnp.asarray(better))
    law, c = start.law, getattr(start.law, "c", None)
    if isinstance(law, AbstractHuntCrossley) and c is not None and "law.c" not in held:
        # A dimensional damping factor means a different damping at a different stiffness.
        alpha = float(law.damping_factor(start.contact, speed))
        if alpha > 0:
            c = c * (min(max(alpha, _DAMPING[0]), _DAMPING[1]) / alpha)
            start = eqx.tree_at(lambda s: s.law.c, start, c)
    return start


def without_a_contact_elsewhere(found: Fit, data: dict[str, Column]) -> Fit:
    """Return the fit, not converged if it misses the contact in a column.

    Differences of neighbouring readings measure the noise; scatter beyond it is the contact. The
    fit must leave less than half of that scatter.
    """
    at = 0
    for name, column in data.items():
        rows = slice(at, at + column.size)
        at += column.size
        noise = float(np.mean(np.square(np.diff(column)))) / 2 if column.size > 1 else math.inf
        signal = float(np.var(column)) - noise
        missed = float(np.nanmean(np.square(found.residuals[rows]))) - noise
        if found.converged and signal > 0 and missed > (1 - _SEEN) * signal:
            part = 100 * max(1 - missed / signal, 0)
            reason = (
                f"its contact misses that of the record: it describes {part:.0f} % of the {name}; "
                "start from another stiffness, speed or `start_time`"
            )
            unknown = np.full_like(found.covariance, np.nan)
            return dataclasses.replace(
                found, converged=False, reason=reason, covariance=unknown, unidentified=()
            )
    return found

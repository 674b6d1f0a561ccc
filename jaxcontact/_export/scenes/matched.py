"""The parameters of each contact of a scene in an engine, and the time step that they need."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Mapping

import jax
import numpy as np

from ..._impact import impact, restitution_is_constant
from ..at_time_step import TimeStepRestitution, restitution_in_steps
from ..export import export
from ..result import Export
from .engine import SceneEngine
from .model import SceneModel, Touch

Pair = tuple[int, int]

_EQUAL = 8
"""Decimals of errors of e that count as equal: a solve is as accurate."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Matched:
    """The contacts of a scene in an engine.

    `exports` has the parameters for each pair of groups. `time_step` in s is the longest with which
    no e changes by more than `tolerance`, that of the steps, at the closing `speeds` in m/s. These
    are the largest one and, if some e depends on speed, the smallest, at which e may be larger.
    `law_error` is the largest error of e with short steps, over all closing speeds.
    """

    exports: Mapping[Pair, Export]
    time_step: float
    law_error: float
    speeds: tuple[float, ...]
    tolerance: float

    def step_error(self, time_step: float) -> float:
        """Return the largest error of e by steps of this length in s.

        Raises ValueError for steps of an engine whose error was measured with shorter ones only.
        """
        if time_step <= self.time_step * (1 + 1e-9):
            return self.tolerance
        first = next(iter(self.exports.values()))
        if first.scheme is None:
            raise ValueError(
                f"Argument `time_step` must be at most {self.time_step:.6g} s for engine "
                f"{first.engine!r}, whose error with longer steps is not known, but is "
                f"{time_step:g}."
            )
        every = itertools.product(_several(self.exports), self.speeds)
        found = [_stepped(x, speed, self.tolerance, time_step) for x, speed in every]
        return max(max(x.high - x.target, x.target - x.low) for x in found)


def matched(
    model: SceneModel, engine: SceneEngine, speeds: np.ndarray, tolerance: float
) -> Matched:
    """Return the parameters of all contacts at these closing speeds in m/s, ascending.

    Raises ValueError for contacts that the engine cannot deliver, and for a tolerance that no step
    keeps.
    """
    exports = {pair: _closest(touch, engine, speeds) for pair, touch in model.touches.items()}
    constant = all(_is_constant(touch, engine) for touch in model.touches.values())
    ends = {float(speeds[-1])} if constant else {float(speeds[0]), float(speeds[-1])}
    law_error = max(float(np.max(np.abs(made.error))) for made in exports.values())
    # The steps get what the law leaves; if that is nothing, the tolerance is missed anyway.
    left = tolerance - law_error if law_error < tolerance else tolerance
    return Matched(
        exports=exports,
        time_step=min(_longest(made, speed, left) for made in _several(exports) for speed in ends),
        law_error=law_error,
        speeds=tuple(ends),
        tolerance=left,
    )


def _is_constant(touch: Touch, engine: SceneEngine) -> bool:
    """Return whether neither e, that of the law and that of the engine, depends on speed."""
    return restitution_is_constant(touch.law, None) and engine.constant


def _closest(touch: Touch, engine: SceneEngine, speeds: np.ndarray) -> Export:
    """Return the export with the smallest error of e among those that the engine offers."""
    # One speed is exact, and enough where neither law depends on it.
    constant = _is_constant(touch, engine)
    at = float(speeds[-1]) if constant or len(speeds) == 1 else speeds
    found, reasons = [], []
    for options in engine.options(touch, constant):
        try:
            found.append(export(touch.law, touch.contact, at, engine=engine.name, **options))
        except ValueError as reason:
            reasons.append(reason)
    if not found:
        raise reasons[0]
    return min(found, key=lambda made: round(float(np.max(np.abs(made.error))), _EQUAL))


def _longest(made: Export, speed: float, tolerance: float) -> float:
    """Return the longest step in s that keeps the e of a contact; ValueError if there is none."""
    if made.scheme is None:
        # Measured with these steps; the error is taken to fall with the step, or faster.
        assert made.steps is not None and made.expected_error is not None
        e = float(np.max(np.asarray(made.delivered)))
        duration = float(impact(made.law, made.contact, speed).duration)
        return duration / made.steps * min(1.0, tolerance / (made.expected_error * e))
    at = _stepped(made, speed, tolerance)
    if not math.isfinite(at.needed):
        raise ValueError(
            f"Argument `tolerance` must be larger for engine {made.engine!r}: no step keeps e "
            f"within {tolerance:g} of {at.target:.4g}."
        )
    return at.time_step * at.duration / at.needed


def _several(exports: Mapping[Pair, Export]) -> Iterable[Export]:
    """Return one export of each kind: with the same law and contact, steps act alike."""
    kinds = {}
    for made in exports.values():
        leaves = jax.tree.leaves((made.law, made.contact))
        kinds.setdefault((made.model, *map(float, leaves)), made)
    return kinds.values()


def _stepped(
    made: Export, speed: float, within: float, time_step: float | None = None
) -> TimeStepRestitution:
    """Return the e of the engine's steps beside that of its own law, at one speed.

    The step is a fiftieth of the contact unless given in s.
    """
    assert made.scheme is not None
    hit = impact(made.law, made.contact, speed)
    duration = float(hit.duration)
    return restitution_in_steps(
        made.law,
        made.contact,
        speed,
        target=float(hit.restitution),
        duration=duration,
        scheme=made.scheme,
        time_step=duration / 50 if time_step is None else time_step,
        within=within,
    )

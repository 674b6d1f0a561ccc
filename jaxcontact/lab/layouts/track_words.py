"""Notes on the camera of a track."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...extend import STANDARD_GRAVITY, counted, span, with_error
from ..track.model import Drop, Track

_SHOWN = 6
_MOST_WRONG = 1.5
"""Factor by which heights in m contradict g; a misplaced length reference cannot explain it."""

_SURE = 3.0


def _mean(values: Sequence[float], errors: Sequence[float]) -> tuple[float, float]:
    """Return the mean weighted by errors, and its standard error."""
    weight = np.array(errors) ** -2.0
    return float(weight @ np.array(values) / weight.sum()), float(weight.sum() ** -0.5)


def _fall(drops: Sequence[Drop]) -> tuple[float, float]:
    return _mean([d.camera.fall for d in drops], [d.camera.fall_error for d in drops])


def camera_notes(drops: Sequence[Drop]) -> tuple[str, ...]:
    """Return notes on impacts and frames, and on scale and tilt of the camera."""
    impacts = sum(drop.impact.size for drop in drops)
    off = sum(int(drop.off.sum()) for drop in drops)
    errors = [1e3 * one for drop in drops for one in drop.error]
    notes = [
        f"{counted(impacts, ('impact', 'impacts'))} in {counted(len(drops), ('drop', 'drops'))}, "
        f"timed to {span(errors, 'ms')}",
        f"{counted(off, ('frame', 'frames'))} off the parabolas left out",
    ]
    if any(drop.frames.sign < 0 for drop in drops):
        notes.append("heights are counted downwards, as the ball falls to larger ones")
    return (*notes, _scale(drops), _tilt(drops), *_nearer(drops), *_air(drops))


def _scale(drops: Sequence[Drop]) -> str:
    """Return the scale of lengths implied by the known g."""
    fall, error = _fall(drops)
    unit = drops[0].frames.unit
    known = f"at g = {STANDARD_GRAVITY:g} m/s²"
    if unit == "m":
        off, spread = fall / STANDARD_GRAVITY - 1, error / STANDARD_GRAVITY
        told = f"the ball falls with {with_error(fall, error)} m/s²"
        if abs(off) <= _SURE * spread:
            return f"{told}, which agrees with g = {STANDARD_GRAVITY:g}"
        word = "long" if off > 0 else "short"
        return (
            f"{told}, but g is {STANDARD_GRAVITY:g}: lengths are {100 * abs(off):.2g} % too "
            f"{word}; speeds do not use them, but times and g"
        )
    scale = 1e3 * STANDARD_GRAVITY / fall
    word = "a pixel" if unit == "px" else "a unit of height"
    return f"{word} is {with_error(scale, scale * error / fall)} mm, {known}"


def _tilt(drops: Sequence[Drop]) -> str:
    tilts = [
        (math.degrees(d.camera.tilt), math.degrees(d.camera.tilt_error))
        for d in drops
        if d.camera.tilt is not None and d.camera.tilt_error is not None
    ]
    if not tilts:
        return "without x a rolled camera cannot be detected, and biases e of a drifting ball"
    tilt, error = _mean(*zip(*tilts, strict=True))
    side = "left" if tilt > 0 else "right"
    return f"the vertical leans to the {side} by {with_error(abs(tilt), error)}°, corrected"


def _nearer(drops: Sequence[Drop]) -> tuple[str, ...]:
    """Return whether the floor rises in the picture, and whether e could be separated from it."""
    several = [drop for drop in drops if drop.impact.size > 1]
    notes = []
    if len(several) < len(drops):
        notes.append("with one impact e cannot be separated from a floor that rises in the picture")
    if several:
        rise, error = _mean(*zip(*[drop.rise for drop in several], strict=True))
        growth, spread = _mean(*zip(*[drop.growth for drop in several], strict=True))
        unit = f" {drops[0].frames.unit}".rstrip()
        if abs(rise) > _SURE * error:
            word = "rises" if rise > 0 else "sinks"
            notes.append(
                f"the floor {word} in the picture by {with_error(abs(rise), error)}{unit} in a "
                "second (floor not level, or ball nearer): corrected"
            )
        if abs(growth) > _SURE * spread:
            word = "nearer" if growth > 0 else "farther away"
            shown = with_error(100 * abs(growth), 100 * spread)
            notes.append(f"the ball comes {word}, by {shown} % in a second: corrected")
    return tuple(notes)


def _air(drops: Sequence[Drop]) -> tuple[str, ...]:
    """Return the drag if significant; with drag, the way down takes longer than up."""
    beta, error = _mean(*zip(*[drop.air for drop in drops if drop.air], strict=True))
    if beta <= _SURE * error:
        return ()
    speed = STANDARD_GRAVITY / math.sqrt(beta)
    told = with_error(speed, speed * error / beta / 2)
    return (f"air drag in the flights: terminal speed {told} m/s",)


def skipped_notes(tracks: Sequence[Track]) -> tuple[str, ...]:
    """Return the impacts that are not used, and why."""
    skipped = [one for track in tracks for one in track.skipped]
    if not skipped:
        return ()
    told = "; ".join(f"at {one.time:.3f} s, {one.why}" for one in skipped[:_SHOWN])
    more = f" and {len(skipped) - _SHOWN} more" if len(skipped) > _SHOWN else ""
    return (f"doubtful and not used: {len(skipped)} ({told}{more})",)


def wrong_lengths(drops: Sequence[Drop]) -> str:
    """Return why heights in m contradict g, with a guess; "" if they agree."""
    fall, _ = _fall(drops)
    ratio = fall / STANDARD_GRAVITY
    if drops[0].frames.unit != "m" or 1 / _MOST_WRONG < ratio < _MOST_WRONG:
        return ""
    slow = f"are times of slow motion, {ratio**-0.5:.3g} times too long? or " if ratio < 1 else ""
    return (
        f"falls with {fall:.3g} m/s², but g is {STANDARD_GRAVITY:g}; {slow}are lengths in another "
        "unit? then write it in the heading, 'y [px]' if unknown"
    )


def shown_e(drops: Sequence[Drop]) -> str:
    """Return e of the first impacts in vacuum, with standard errors."""
    told = []
    for drop in drops:
        seconds = drop.seconds
        for k in range(drop.impact.size):
            slope = np.zeros(seconds.size)
            slope[k], slope[k + 1] = -1 / seconds[k], 1 / seconds[k + 1]
            e = float(seconds[k + 1] / seconds[k])
            told.append(with_error(e, e * math.sqrt(float(slope @ drop.covariance @ slope))))
    more = ", ..." if len(told) > _SHOWN else ""
    return ", ".join(told[:_SHOWN]) + more

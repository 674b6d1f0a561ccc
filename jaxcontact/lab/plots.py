"""Figures of the laboratory: e over speed, the choice of a law, records, sounds and tracks."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..extend import (
    CURVES,
    DATA,
    axes_for,
    axes_of,
    legend_above,
    put_label,
    rendered,
    require_kind,
)
from .calibration.calibrate import Calibration
from .choice.law_choice import ChoiceData, LawChoice
from .recordings import RecordedImpact, Recording, tracks_of
from .track.model import Drop, Track

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LINE, _USED, _DOUBTFUL = "#999999", "#0072B2", "#D55E00"
_SOUND, _PARABOLA, _LEFT_OUT = "#777777", "#000000", "#CC79A7"
_FINE, _POINTS = 200, 4000
_ROOM = 0.35
_MANY = 60
"""Number of points above which they are drawn smaller."""


def calibration(result: Calibration, *, ax: Axes | None = None) -> Axes:
    """Draw e over approach speed (m/s): kept and marked pairs, and each fit ± 2 standard errors.

    Marked pairs outside the frame are drawn at its edge as arrows, so that all are visible. Returns
    the axes, new ones if `ax` is None. Raises ValueError unless `result` is a `Calibration` and
    `ax` are axes.
    """
    require_kind("result", result, Calibration, "a `Calibration` (see `calibrate`)")
    ax = axes_of(ax, figsize=(7.0, 4.6))
    pairs, flagged = result.recorded_pairs, result.outliers.flagged
    v, e = pairs.velocity, pairs.restitution
    low, high = frame_of(e[~flagged])
    draw_points(ax, v[~flagged], e[~flagged], "kept")
    _draw_marked(ax, v[flagged], e[flagged], low, high)
    speeds = np.linspace(v[~flagged].min(), v[~flagged].max(), _FINE)
    styles = curves_of(result.choice)
    for law in result.choice.laws:
        curve, error = result.choice.curve(law.kind, speeds)
        style = styles[law.kind]
        ax.plot(speeds, curve, lw=1.8, label=law.kind, **style)
        if law.identifiable:
            low_end, high_end = curve - 2 * error, curve + 2 * error
            ax.fill_between(speeds, low_end, high_end, color=style["color"], alpha=0.16, lw=0)
    ax.set_ylim(low, high)
    margin = 0.04 * max(float(np.ptp(v)), 0.1)
    ax.set_xlim(max(float(v.min()) - margin, 0.0), float(v.max()) + margin)
    put_label(ax.xaxis, "velocity", "approach speed")
    air = {True: "drag taken out", False: "drag left in"}[pairs.flight.drag is not None]
    ax.set_ylabel("restitution $e$" + (f" ({air})" if pairs.layout.uses_flight else ""))
    legend_above(ax)
    return ax


def _draw_marked(ax: Axes, v: np.ndarray, e: np.ndarray, low: float, high: float) -> None:
    edge = 0.02 * (high - low)
    inside = (e >= low + edge) & (e <= high - edge)
    label, shown = f"left out ({len(e)})", np.clip(e, low + edge, high - edge)
    for marker, which in (("x", inside), ("^", e > high - edge), ("v", e < low + edge)):
        if which.any():
            style: dict[str, Any] = {"color": _LEFT_OUT, "ms": 6, "clip_on": False, "label": label}
            ax.plot(v[which], shown[which], marker, **style)
            label = "_"  # one entry in the legend


_SHOWN = 6
_LABEL = {
    "force": "force / N",
    "acceleration": "acceleration / (m/s²)",
    "indentation": "indentation / m",
}


def record(recording: Recording | Calibration, *, ax: Any = None) -> Any:
    """Draw the record of an instrument with the impacts separated from it.

    `recording` is one of force, acceleration or indentation, or its calibration. Used impacts have
    numbers, doubtful ones crosses. The curve shows the largest and smallest reading in each of at
    most 4000 time intervals. For a calibration two axes are drawn: the second shows the readings of
    the first six impacts over the time since touch, with the fitted curves. `ax`: one, or two for a
    calibration. Returns the axes, new ones if `ax` is None. Raises ValueError for other recordings,
    and for invalid axes.
    """
    fits = getattr(recording, "impact_fits", ())
    impacts: list[RecordedImpact] = [one.impact for one in fits]
    if isinstance(recording, Recording) and recording.layout.fitted:
        impacts = list(recording.records)  # pyright: ignore[reportAssignmentType]
    if not impacts:
        raise ValueError(
            "Argument `recording` must be that of force, acceleration or indentation over time, or "
            f"its calibration, but is {rendered(recording)}."
        )
    if not fits:
        return _whole(axes_of(ax), impacts)
    if ax is None:
        from matplotlib import pyplot

        ax = pyplot.subplots(2, figsize=(8.0, 7.0), layout="constrained")[1]
    above, below = axes_for(ax, 2, "view")
    _whole(above, impacts)
    _fits(below, fits)
    return np.array([above, below])


def _whole(ax: Axes, impacts: list[RecordedImpact]) -> Axes:
    trace = impacts[0].trace
    width = max(-(-trace.time.size // (_POINTS // 2)), 1)
    at = np.arange(0, trace.time.size, width)
    both = [f.reduceat(trace.value, at) for f in (np.minimum, np.maximum)]
    ax.plot(np.repeat(trace.time[at], 2), np.stack(both, axis=1).ravel(), color=_LINE, lw=0.8)
    tops = [float(trace.value[one.start : one.stop].max()) for one in impacts]
    touches = [float(trace.time[0] + one.touch * trace.step) for one in impacts]
    ax.plot(touches, tops, "v", color=_USED, ms=6, ls="none", label="impact, used")
    _numbered(ax, [one.number for one in impacts], touches, tops)
    if trace.doubtful:
        times = [one.time for one in trace.doubtful]
        height = np.interp(times, trace.time, trace.level)
        ax.plot(times, height, "x", color=_DOUBTFUL, ms=6, ls="none", label="doubtful, not used")
    ax.set_ylim(top=float(trace.value.max()) + 0.12 * float(np.ptp(trace.value)))
    return _over_time(ax, _LABEL[trace.quantity])


def _numbered(ax: Axes, numbers: Iterable[int], x: Any, y: Any, below: bool = False) -> None:
    """Write numbers above points, or below them."""
    va, shift = ("top", -6) if below else ("baseline", 5)
    place: Any = {"ha": "center", "va": va, "textcoords": "offset points"}
    for number, *at in zip(numbers, x, y, strict=True):
        ax.annotate(str(number), (at[0], at[1]), (0, shift), fontsize="small", color=_USED, **place)


def _over_time(ax: Axes, label: str) -> Axes:
    ax.set_xlabel("time $t$ / s")
    ax.set_ylabel(label)
    legend_above(ax)
    return ax


def _fits(ax: Axes, fits: Any) -> Axes:
    for k, one in enumerate(fits[:_SHOWN]):
        trace, color = one.impact.trace, f"C{k}"
        count = one.time.size
        (predicted,) = one.fit.predict().values()
        scale = float(np.max(np.abs(one.reading)))
        own = float(np.max(np.abs(one.fit.data[:count])))
        since = 1e3 * (one.time - one.touch)
        ax.plot(since, one.reading, ".", color=color, ms=2.5, alpha=0.6)
        curve = np.asarray(predicted)[:count] * (scale / own if own > 0 else 1)
        ax.plot(since, curve, color=color, lw=1.2, label=f"{one.impact.number}")
        ax.set_ylabel(_LABEL[trace.quantity])
    ax.set_xlabel("time since touch / ms")
    ax.legend(frameon=False, fontsize="small", title="impact and its fit", title_fontsize="small")
    return ax


_ABOVE = 0.06


def sound(recording: Recording, *, ax: Axes | None = None) -> Axes:
    """Draw the level of a sound recording in dB over its noise, with marks at the detected sounds.

    Used bounces have numbers at the first and the last of each drop; doubtful ones and other sounds
    are not used. The level is that after the whitening filter, its maximum in each of at most 4000
    time intervals. Returns the axes, new ones if `ax` is None. Raises ValueError for a recording
    that is not a sound, and for invalid axes.
    """
    require_kind("recording", recording, Recording, "a `Recording` (see `read_recording`)")
    heard = recording.sound
    ax = axes_of(ax, figsize=(8.0, 4.0))
    if heard is None:
        raise ValueError(
            "Argument `recording` must be that of a sound file, but is read from "
            f"{rendered(recording.source)}."
        )
    found = heard.envelope
    level = 10 * np.log10(np.maximum(found.energy / found.noise, 1e-2))
    width = max(-(-level.size // _POINTS), 1)
    time = found.step * np.arange(level.size)
    at = np.arange(0, level.size, width)
    ax.plot(time[at], np.maximum.reduceat(level, at), color=_LINE, lw=0.8)
    top = float(level.max())
    used = [one.time for drop in heard.drops for one in drop]
    groups = (
        ("v", _USED, "bounce, used", used),
        ("x", _DOUBTFUL, "doubtful, not used", [o.time for o in heard.others if o.doubtful]),
        (".", _SOUND, "other sound", [o.time for o in heard.others if not o.doubtful]),
    )
    for row, (marker, colour, label, times) in enumerate(groups):
        if times:
            height = np.full(len(times), top * (1 + _ABOVE * (3 - row)))
            ax.plot(times, height, marker, color=colour, ms=6, mew=1.5, ls="none", label=label)
    ends = [one for drop in heard.drops for one in (drop[0], drop[-1])]
    height = np.full(len(ends), top * (1 + 3 * _ABOVE))
    _numbered(ax, [one.number for one in ends], [one.time for one in ends], height)
    ax.set_ylim(min(0.0, float(np.quantile(level, 0.05))), top * (1 + 6 * _ABOVE))
    ax.set_xlim(0, heard.seconds)
    return _over_time(ax, "level over the noise / dB")


_UNIT = {"": "", "m": " / m", "px": " / px"}
_MARGIN = 0.15
"""Margin above and below, as a fraction of the range of heights."""


def track(recording: Recording | Calibration, *, ax: Axes | None = None) -> Axes:
    """Draw the heights of a track over time, with the fitted parabolas.

    `recording` is that of a track, or its calibration. Fitted frames are full dots, misreadings
    crosses, and others (near impacts, held, at rest) open circles. Impacts are triangles with their
    numbers in the drop; dotted lines mark doubtful impacts that are not used. Heights are those of
    the file; if they count downwards, so does the axis. Returns the axes, new ones if `ax` is None.
    Raises ValueError for other recordings, and for invalid axes.
    """
    tracks: tuple[Track, ...] = ()
    if isinstance(recording, Calibration):
        tracks = tracks_of(itertools.chain(*recording.recorded_pairs.records))
    elif isinstance(recording, Recording):
        tracks = recording.tracks
    ax = axes_of(ax, figsize=(8.0, 4.0))
    if not tracks:
        raise ValueError(
            "Argument `recording` must be that of a track, or its calibration, but is "
            f"{rendered(recording)}."
        )
    frames = tracks[0].frames
    for number, one in enumerate(tracks):
        _frames(ax, one, labels=number == 0)
        for drop in one.drops:
            _drop(ax, drop)
        for skipped in one.skipped:
            ax.axvline(skipped.time, color=_DOUBTFUL, lw=0.6, ls=":")
    low, high = _range([drop for one in tracks for drop in one.drops])
    ax.set_ylim(*sorted((frames.sign * low, frames.sign * high)))
    if frames.sign < 0:
        ax.invert_yaxis()
    return _over_time(ax, f"height{_UNIT[frames.unit]}")


def _frames(ax: Axes, track: Track, labels: bool) -> None:
    frames = track.frames
    used, off = (
        np.any([getattr(drop, name) for drop in track.drops], axis=0) for name in ("used", "off")
    )
    open_circle = {"marker": "o", "ms": 2.5, "mfc": "none", "mew": 0.6, "color": _LINE}
    groups = (
        (used, {"marker": ".", "ms": 4, "color": _USED}, "frame, used"),
        (off, {"marker": "x", "ms": 5, "color": _DOUBTFUL}, "frame off the parabolas"),
        (~used & ~off, open_circle, "other frame"),
    )
    for where, style, label in groups:
        if where.any():
            height = frames.sign * frames.height[where]
            name = label if labels else None
            ax.plot(frames.time[where], height, ls="none", label=name, **style)


def _drop(ax: Axes, drop: Drop) -> None:
    sign = drop.frames.sign
    inside = np.isfinite(drop.fitted)
    time = np.concatenate([drop.frames.time[inside], drop.impact])
    height = np.concatenate([drop.fitted[inside], drop.floor])
    order = np.argsort(time)
    ax.plot(time[order], sign * height[order], color=_PARABOLA, lw=0.8)
    ax.plot(drop.impact, sign * drop.floor, "^", color=_USED, ms=6)
    count = range(1, len(drop.impact) + 1)
    _numbered(ax, count, drop.impact, sign * drop.floor, below=True)


def _range(drops: Sequence[Drop]) -> tuple[float, float]:
    """Return the range of heights of the ball; misreadings may lie far outside."""
    fitted = np.concatenate([drop.fitted[np.isfinite(drop.fitted)] for drop in drops])
    used = np.concatenate([drop.frames.height[drop.used] for drop in drops])
    low, high = float(fitted.min()), float(max(fitted.max(), used.max()))
    room = _MARGIN * (high - low)
    return low - 1.3 * room, high + room


def choice(result: LawChoice, *, ax: Axes | None = None) -> Axes:
    """Draw e over the closing speed (m/s): the data, and the curve of each kind of law.

    The law of lowest AICc has the thickest line. The grey line is a free smooth curve, not a law.
    The frame is that of the data, which the curve of an excluded law may leave.
    Arguments: the result of `choose_law`; the axes to draw on, new ones if None. Returns the axes.
    Raises ValueError for anything but a `LawChoice` and axes.
    """
    require_kind("result", result, LawChoice, "a `LawChoice` (see `choose_law`)")
    ax = axes_of(ax, figsize=(7.0, 4.6))
    any_fit = next(iter(result.fits.values()))
    x = np.asarray(any_fit.problem.x)
    # ln e comes before contact times and forces.
    log_e = any_fit.data[: len(x)]
    used = np.isfinite(log_e)
    v = x[used]
    draw_points(ax, v, np.exp(log_e[used]), "data")
    wide = v.max() > 100 * v.min()
    fine = (np.geomspace if wide else np.linspace)(v.min(), v.max(), _FINE)
    best = min(candidate.aicc for candidate in result.candidates)
    styles = curves_of(result)
    for place, candidate in enumerate(result.candidates):
        label = f"{candidate.name} ({candidate.aicc - best:.1f})"
        curve, _ = result.curve(candidate.name, fine)
        thick = 2.6 if place == 0 else 1.4
        ax.plot(fine, curve, lw=thick, label=label, zorder=3, **styles[candidate.name])
    free = {"color": _LINE, "lw": 4, "alpha": 0.5, "zorder": 2, "label": "free curve, no law"}
    ax.plot(fine, result.free(fine), **free)
    ax.set_ylim(*frame_of(np.exp(log_e[used])))
    if wide:
        ax.set_xscale("log")
    put_label(ax.xaxis, "velocity")
    ax.set_ylabel("restitution $e$")
    legend_above(ax, "law (ΔAICc)")
    return ax


def frame_of(e: np.ndarray) -> tuple[float, float]:
    """Return the lowest and the highest e of a plot of measured e."""
    low, high = float(e.min()), float(e.max())
    room = _ROOM * max(high - low, 0.02)
    return low - room, high + room


def draw_points(ax: Axes, v: np.ndarray, e: np.ndarray, label: str) -> None:
    """Draw measured e over speed, in front of curves and bands, with a light edge."""
    size = 3.8 if len(v) > _MANY else 6.0
    look = {"color": DATA, "mec": "white", "mew": 0.4, "ms": size, "zorder": 4}
    ax.plot(v, e, "o", label=label, **look)


def curves_of(choice: ChoiceData) -> dict[str, dict[str, Any]]:
    """Return the style of the curve of each kind of law, the same in every plot of a choice."""
    n = len(CURVES)
    # Beyond the last style a colour comes again with another line.
    places = [(k % n, (k + n // 2 * (k // n)) % n) for k in range(len(choice.laws))]
    return {
        law.kind: {"color": CURVES[colour][0], "ls": CURVES[line][1]}
        for law, (colour, line) in zip(choice.laws, places, strict=True)
    }

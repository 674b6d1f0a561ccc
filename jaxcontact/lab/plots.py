"""Figures of the laboratory: e over speed, the choice of a law, records, sounds and tracks."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..extend import (
    CURVES,
    DATA,
    axes_for,
    axes_of,
    counted,
    legend_above,
    put_label,
    refusal,
    rendered,
    require_choice,
    require_kind,
)
from .calibration.calibrate import Calibration
from .calibration.verdict import headlines, scatter_said
from .choice.law_choice import LawChoice
from .recordings import RecordedImpact, Recording, tracks_of
from .track.model import Drop, Track

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LINE, _USED, _DOUBTFUL = "#999999", "#0072B2", "#D55E00"
_SOUND, _PARABOLA, _LEFT_OUT = "#777777", "#000000", "#CC79A7"
_FINE, _POINTS = 200, 4000
_SHOW, _SIZE = ("possible", "all"), (7.0, 4.6)
_ROOM = 0.35
_MANY, _FEW = 60, 12
"""Number of points above which they are drawn smaller, and up to which they have error bars."""

_LINE_OF_TEXT = 0.16
"""Height in inches of a line of small text."""


def calibration(result: Calibration, *, show: str = "possible", ax: Axes | None = None) -> Axes:
    """Draw e over the closing speed (m/s): the pairs, and the chosen law ± 2 standard errors.

    The title has e with its 95 % interval. Laws that are not ruled out are thin, with their names
    at the ends of their lines; `show="all"` adds those that are, in grey. Pairs left out are
    crosses; those beyond the frame are at its edge. Up to twelve pairs with known errors have bars
    of ± 2 standard errors. Returns the axes, new ones if `ax` is None. Raises ValueError unless
    `result` is a `Calibration`, `show` is "possible" or "all", and `ax` are axes.
    """
    require_kind("result", result, Calibration, "a `Calibration` (see `calibrate`)")
    require_choice("show", show, _SHOW)
    ax = axes_of(ax, figsize=_SIZE)
    pairs, law = result.recorded_pairs, result.chosen
    air = {True: "drag taken out", False: "drag left in"}[pairs.flight.drag is not None]
    words = f" ({air})" if pairs.layout.uses_flight else ""
    scatter = "" if result.scatter is None else f", scatter {scatter_said(result.scatter)}"
    bars = np.array([0.0 if p.error is None else 2 * p.error for p in result.pairs])
    bars = bars if len(bars) <= _FEW else np.zeros(len(bars))
    data = _Measured(pairs.velocity, pairs.restitution, result.outliers.flagged, bars, scatter)
    _frame_choice(ax, data, words)
    _draw_laws(ax, result.choice, None if law is None else law.kind, {}, data.fine, show)
    legend_above(ax, heading=headlines(result)[0])
    return ax


def choice(result: LawChoice, *, show: str = "possible", ax: Axes | None = None) -> Axes:
    """Draw e over the closing speed (m/s): the data, and the curves of the laws.

    The law of the verdict, `result.best`, has the thickest line and a band of ± 2 standard errors.
    Laws that are not ruled out are thin; `show="all"` adds those that are, in grey. Each has its
    name and its ΔAICc at the end of its line. The broad grey line is a free smooth curve, not a
    law. The frame is that of the data.

    Arguments: the result of `choose_law`; `show`, "possible" or "all"; the axes to draw on, new
    ones if None. Returns the axes. Raises ValueError for anything but these.
    """
    require_kind("result", result, LawChoice, "a `LawChoice` (see `choose_law`)")
    require_choice("show", show, _SHOW)
    ax = axes_of(ax, figsize=_SIZE)
    any_fit = next(iter(result.fits.values()))
    x = np.asarray(any_fit.problem.x)
    # ln e comes before contact times and forces.
    log_e = any_fit.data[: len(x)]
    used = np.isfinite(log_e)
    marked = int(result.marked.sum())
    note = f", {marked} left out" if marked else ""
    none = np.zeros(used.sum())
    data = _Measured(x[used], np.exp(log_e[used]), none > 0, none, note)
    _frame_choice(ax, data, "")
    free = {"color": _LINE, "lw": 5, "alpha": 0.4, "zorder": 1.5, "label": "free curve, no law"}
    ax.plot(data.fine, result.free(data.fine), ls="-", **free)
    least = min(candidate.aicc for candidate in result.candidates)
    names = {one.name: f"{one.name} ({one.aicc - least:.1f})" for one in result.candidates}
    _draw_laws(ax, result, result.best, names, data.fine, show)
    sure = "sure" if result.sure else "not sure"
    legend_above(ax, heading=f"best: {result.best} ({sure}); at the lines: ΔAICc")
    return ax


class _Measured(NamedTuple):
    """Measured e over speed (m/s), which pairs are left out, error bars, and a note."""

    v: np.ndarray
    e: np.ndarray
    out: np.ndarray
    bars: np.ndarray
    note: str

    @property
    def wide(self) -> bool:
        return bool(self.v.max() > 100 * self.v.min())

    @property
    def fine(self) -> np.ndarray:
        """Speeds between the ends of the pairs that are not left out, around a single one."""
        v = self.v[~self.out]
        ends = (v.min(), v.max()) if np.ptp(v) > 0 else (0.5 * v[0], 1.5 * v[0])
        return (np.geomspace if self.wide else np.linspace)(*ends, _FINE)


def _frame_choice(ax: Axes, data: _Measured, words: str) -> None:
    """Draw the pairs, in the frame of those not left out; e above 1 only if a pair is there."""
    v, kept, bars = (column[~data.out] for column in (data.v, data.e, data.bars))
    low, high = float(np.min(kept - bars)), float(np.max(kept + bars))
    room = _ROOM * max(high - low, 0.02)
    low, high = low - room, high + room
    high = high if data.e.max() > 1 else min(high, 1.0)
    look: dict[str, Any] = {"ms": 3.8 if len(kept) > _MANY else 6.0, "ls": "none"}
    look |= {"clip_on": False, "zorder": 4}
    label = f"measured ({counted(len(kept), ('pair', 'pairs'))}{data.note})"
    ax.plot(v, kept, "o", color=DATA, mec="white", mew=0.4, label=label, **look)
    if bars.any():
        ax.errorbar(v, kept, bars, fmt="none", ecolor=DATA, elinewidth=1.0, capsize=3, zorder=4)
    if data.out.any():
        edge = 0.02 * (high - low)
        e = np.clip(data.e[data.out], low + edge, high - edge)
        beyond = int(np.sum((data.e[data.out] < low) | (data.e[data.out] > high)))
        more = f"; {beyond} beyond the frame" if beyond else ""
        label = f"left out ({len(e)}{more})"
        look["ms"] = 6.0
        ax.plot(data.v[data.out], e, "x", color=_LEFT_OUT, label=label, **look)
    if data.wide:
        ax.set_xscale("log")
    else:
        ends = np.append(data.v, data.fine[[0, -1]])
        margin = 0.04 * np.ptp(ends)
        ax.set_xlim(max(ends.min() - margin, 0.0), ends.max() + margin)
    ax.set_ylim(low, high)
    put_label(ax.xaxis, "velocity")
    ax.set_ylabel("restitution $e$" + words)


def _draw_laws(
    ax: Axes, choice: LawChoice, law: str | None, names: Mapping[str, str], v: Any, show: str
) -> None:
    """Draw the curves of the laws, and write their names at the ends of the lines."""
    ends = []
    possible = {law, choice.best, *choice.rivals}
    looks = itertools.cycle(CURVES[1:])
    for kind in (one.kind for one in choice.laws):
        if kind not in possible and show != "all":
            continue
        curve, error = choice.curve(kind, v)
        color, line = next(looks) if kind in possible - {law} else (_LINE, ":")
        look: dict[str, Any] = {"color": color, "ls": line, "lw": 1.1, "zorder": 3.5}
        if kind == law:
            look = {"color": CURVES[0][0], "ls": "-", "lw": 2.6, "zorder": 3}
            if choice.law_fit(kind).identifiable and np.isfinite(error).all():
                band = {"color": look["color"], "alpha": 0.2, "lw": 0, "zorder": 2}
                ax.fill_between(v, curve - 2 * error, curve + 2 * error, **band)
                look["label"] = f"{kind} ± 2 standard errors"
            look.setdefault("label", kind)
        ax.plot(v, curve, **look)
        ends.append((float(curve[-1]), names.get(kind, kind), look["color"], kind == law))
    _write_at_ends(ax, float(v[-1]), ends)


def _write_at_ends(ax: Axes, x: float, ends: list[tuple[float, str, str, bool]]) -> None:
    """Write names right of the frame at the heights of their lines' ends, one above the other."""
    (low, high), figure = ax.get_ylim(), ax.get_figure(root=True)
    assert figure is not None  # created with these axes, or by the user
    # The legend and the labels take a part of the height.
    inches = 0.75 * ax.get_position(original=True).height * figure.get_figheight()
    step = _LINE_OF_TEXT / inches
    ends = sorted(ends)
    heights = np.clip([y for y, *_ in ends], low, high)
    wanted = (heights - low) / (high - low)
    steps = step * np.arange(len(ends))
    # Both are at least a step apart, and so is their mean; no name is above or below the frame.
    up = np.maximum.accumulate(wanted - steps) + steps
    down = np.minimum.accumulate((wanted - steps)[::-1])[::-1] + steps
    places = np.clip((up + down) / 2 - steps, 0, max(1 - step * (len(ends) - 1), 0)) + steps
    for (_, name, color, bold), y, place in zip(ends, heights, places, strict=True):
        ax.annotate(
            name,
            (x, y),
            (1.03, place),
            textcoords="axes fraction",
            arrowprops=dict.fromkeys(("shrinkA", "shrinkB"), 0)
            | {"arrowstyle": "-", "color": color, "lw": 0.6, "relpos": (0, 0.5)},
            annotation_clip=False,
            color=color,
            fontsize="small",
            fontweight="bold" if bold else "normal",
            va="center",
        )


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
        must = "be that of force, acceleration or indentation over time, or its calibration"
        raise refusal("recording", must, recording)
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
    for one in fits[:_SHOWN]:
        trace = one.impact.trace
        count = one.time.size
        (predicted,) = one.fit.predict().values()
        scale = float(np.max(np.abs(one.reading)))
        own = float(np.max(np.abs(one.fit.data[:count])))
        since = 1e3 * (one.time - one.touch)
        curve = np.asarray(predicted)[:count] * (scale / own if own > 0 else 1)
        (line,) = ax.plot(since, curve, lw=1.2, label=f"{one.impact.number}")
        ax.plot(since, one.reading, ".", color=line.get_color(), ms=2.5, alpha=0.6, zorder=1)
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
        raise refusal("recording", "be that of a track, or its calibration", recording)
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

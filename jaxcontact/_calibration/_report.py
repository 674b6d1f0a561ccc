"""A calibration in words."""

from __future__ import annotations

import math
import textwrap

import numpy as np

from .._measurements import counted
from .._measurements._outliers import THRESHOLD
from ._calibrate import Calibration, Estimate, FitSet, LawFit
from ._statistics import LEAST_CLUSTERS

_NOISE_NOTE = (
    "the scatter was fitted to the same pairs about a free trend: a reduced chi² near 1 says that "
    "a law does as well as that trend, not that the noise is understood"
)

_SPEED_BINS = 5
_WIDTH = 100
_INDENT = 11


def _wrap(head: str, text: str) -> list[str]:
    return textwrap.wrap(
        text,
        _WIDTH,
        initial_indent=f"{head:<{_INDENT}}",
        subsequent_indent=" " * _INDENT,
        break_long_words=False,
        break_on_hyphens=False,
    )


def report(calibration: Calibration) -> str:
    """The calibration as text for people: data, marked pairs, fits, comparison, what stays open."""
    parts = [
        _data(calibration),
        _marked(calibration),
        _fits(calibration),
        _by_speed(calibration),
        _comparison(calibration),
        _asked(calibration),
        _side_by_side(calibration),
        _open_questions(calibration),
    ]
    return "\n\n".join("\n".join(lines) for lines in parts if lines) + "\n"


def _data(c: Calibration) -> list[str]:
    p = c.pairs
    lines = [
        f"Recording  {p.source}" + (f", ball {p.ball}" if p.ball else ""),
        *_wrap(
            "Pairs",
            f"{len(p)} of approach speed and e, from {p.layout.made_of}; {p.velocity.min():.3g} to "
            f"{p.velocity.max():.3g} m/s, "
            f"{counted(len(np.unique(p.cluster)), p.layout.cluster_words)}",
        ),
    ]
    if p.unpaired:
        rows = counted(p.unpaired, ("row makes", "rows make"))
        lines += _wrap("", f"{rows} no pair: {p.layout.pair_rule}")
    lines += _wrap("Air drag", drag_sentence(c))
    lines += _wrap("Scatter", _scatter(c))
    return lines


def drag_sentence(c: Calibration) -> str:
    """Whether and how the drag of the air was taken out of the flights."""
    if not c.pairs.layout.uses_flight:
        return f"plays no part: {c.pairs.layout.made_of} give the speeds at the impact itself"
    drag = c.pairs.flight.drag
    if drag is None:
        return (
            "is left in: e holds what the air takes in flight, and for a light ball a trend of "
            "e with speed is mostly that; give --mass --radius --drag-coefficient to "
            "take it out"
        )
    return (
        f"taken out of the flights: quadratic, terminal speed {c.pairs.flight.terminal_speed:.3g} "
        f"m/s (mass {drag.mass:g} kg, radius {drag.radius:g} m, coefficient "
        f"{drag.coefficient:g}, air {drag.air_density:g} kg/m³; "
        "standard errors below hold no error of these)"
    )


def _scatter(c: Calibration) -> str:
    text = f"{100 * c.noise.relative:.2g} % of e"
    error = c.pairs.layout.reading_error
    if error is not None:
        text += f", and {error.factor * c.noise.reading:.2g} {error.shown} in {error.of}"
    return text + " (fitted to the pairs that were kept)"


def _marked(c: Calibration) -> list[str]:
    flagged = np.flatnonzero(c.outliers.flagged)
    if not len(flagged):
        return [
            f"Marked     none of {len(c.pairs)} pairs is more than {THRESHOLD:g} robust standard "
            "deviations off the trend"
        ]
    lines = [
        f"Marked     {len(flagged)} of {len(c.pairs)} pairs are more than {THRESHOLD:g} robust "
        "standard deviations off the trend",
        "           and are left out of the fits (shown with them further down)",
        f"  {'rows':<13}{'v (m/s)':>8}{'e':>8}{'deviation':>11}   may be",
    ]
    for k in flagged:
        rows = f"{c.pairs.first_row[k]}"
        if c.pairs.second_row[k] != c.pairs.first_row[k]:
            rows += f", {c.pairs.second_row[k]}"
        lines.append(
            f"  {rows:<13}{c.pairs.velocity[k]:>8.3f}{c.pairs.restitution[k]:>8.3f}"
            f"{c.outliers.deviation[k]:>+11.1f}   {c.outliers.guess[int(k)]}"
        )
    return lines


def with_error(estimate: Estimate) -> str:
    """`0.8799 ± 0.0010 unit`, the error with two digits; without one, that it is not determined."""
    unit = f" {estimate.unit}" if estimate.unit else ""
    if estimate.standard_error is None:
        return f"{estimate.value:.3g}{unit} (not determined)"
    error = estimate.standard_error
    if not error > 0:
        return f"{estimate.value:.6g} ± 0{unit}"
    places = 1 - math.floor(math.log10(error))
    if 0 <= places <= 6 and abs(estimate.value) < 1e6:
        return f"{estimate.value:.{places}f} ± {error:.{places}f}{unit}"
    # As many digits of the value as the error warrants.
    size = math.floor(math.log10(abs(estimate.value))) if estimate.value else 0
    digits = max(size + places, 0)
    return f"{estimate.value:.{digits}e} ± {error:.1e}{unit}"


def errors_sentence(c: Calibration) -> str:
    """How the standard errors were found, and what they allow for."""
    if any(fit.error_kind == "by pair" for fit in c.kept.fits):
        return (
            f"take pairs as independent: fewer than {LEAST_CLUSTERS} "
            f"{c.pairs.layout.cluster_words[1]} cannot tell how they are correlated"
        )
    return c.pairs.layout.errors_words


def _fits(c: Calibration) -> list[str]:
    lines = _wrap("Fits", f"standard errors {errors_sentence(c)}")
    lines += _wrap("", _NOISE_NOTE)
    for fit in c.kept.fits:
        lines.append(f"  {fit.curve.label}")
        for estimate in fit.estimates:
            lines.append(f"    {estimate.name:<16}{with_error(estimate)}")
        lines.append(
            f"    {'residual':<16}rms of e {fit.rms:.4f}; reduced chi² {fit.reduced_chi2:.2f}; "
            f"AICc {fit.aicc:.1f}"
        )
        lines.append(f"    {'converged':<16}{_convergence(fit)}")
        if not fit.determined:
            lines.append(
                "    the best value lies at the edge of the law's range: not determined by the data"
            )
    return lines


def _convergence(fit: LawFit) -> str:
    answer = "yes" if fit.converged else "NO"
    return (
        f"{answer}: {fit.reason} (gradient {fit.gradient_norm:.1e} after {fit.evaluations} "
        "evaluations)"
    )


def _by_speed(c: Calibration) -> list[str]:
    keep = ~c.outliers.flagged
    v, e = c.pairs.velocity[keep], c.pairs.restitution[keep]
    if len(v) < 2 * _SPEED_BINS or v.max() == v.min():
        return []
    order = np.argsort(v, kind="stable")
    names = [_short(fit) for fit in c.kept.fits]
    head = "".join(f"{name:>18}" for name in names)
    lines = [
        "By speed   medians of the kept pairs, and the fits there",
        f"  {'v (m/s)':>8}{'pairs':>7}{'e':>8}{head}",
    ]
    for chunk in np.array_split(order, _SPEED_BINS):
        middle = float(np.median(v[chunk]))
        fits = "".join(f"{np.interp(middle, c.grid, fit.grid):>18.4f}" for fit in c.kept.fits)
        lines.append(f"  {middle:>8.3f}{len(chunk):>7}{np.median(e[chunk]):>8.4f}{fits}")
    return lines


def _short(fit: LawFit) -> str:
    return fit.curve.law if fit.curve.kind != "constant" else f"constant ({fit.curve.law})"


def _comparison(c: Calibration) -> list[str]:
    fits = sorted(c.kept.fits, key=lambda fit: fit.aicc)
    least = min(fit.bic for fit in fits)
    lines = [
        "Choice     the less the better; held out: rms residual over its noise of pairs of speeds "
        "left out",
        f"  {'':<24}{'ΔAICc':>8}{'ΔBIC':>8}{'held out':>10}",
    ]
    lines += [
        f"  {fit.curve.label:<24}{fit.aicc - fits[0].aicc:>8.1f}{fit.bic - least:>8.1f}"
        f"{fit.held_out:>10.3f}"
        for fit in fits
    ]
    told = []
    for comparison in c.kept.comparisons:
        told += _wrap("" if told else "Compared", comparison.verdict)
    lines += told
    lines += _wrap("", line_sentence(c.kept))
    caution = drag_caution(c)
    return lines + (_wrap("", caution) if caution else [])


def _asked(c: Calibration) -> list[str]:
    delivered = c.kept.fits[0].estimates[-1]
    able = [f"{a.law} {a.e:.4f}" for a in c.asked if a.e is not None]
    unable = [f"{a.law} ({a.least:.3f} at least)" for a in c.asked if a.e is None]
    text = f"for a constant e of {delivered.value:.4f} ask {', '.join(able)}"
    if unable:
        text += f"; not within reach of {', '.join(unable)}"
    return _wrap("Law's e", text)


def drag_caution(c: Calibration) -> str | None:
    """A warning where a fall of e with speed was found while the drag of the air was left in."""
    if not c.pairs.layout.uses_flight or c.pairs.flight.drag is not None:
        return None
    if c.kept.line.slope > -2 * c.kept.line.slope_error:
        return None
    return "the drag of the air is left in: the fall of e with speed may be drag, not the contact"


def line_sentence(fits: FitSet) -> str:
    """The trend of a free straight line beside the laws, and whether it does clearly better."""
    line = fits.line
    if not math.isfinite(line.slope_error):
        return "there is only one speed, so nothing tells a trend with speed"
    trend = (
        f"a free line (no law) has d ln e/dv = {line.slope:+.4f} ± {line.slope_error:.4f} per m/s"
    )
    best = min(fits.fits, key=lambda fit: fit.aicc)
    gain = best.aicc - line.aicc
    if gain > 2:
        return f"{trend}; its AICc is {gain:.1f} below the best law: no law here has that trend"
    return f"{trend}; it is no clear gain over the best law (AICc {-gain:+.1f})"


def _side_by_side(c: Calibration) -> list[str]:
    if not c.outliers.flagged.any():
        return []
    lines = [
        "With and without the marked pairs",
        f"  {'':<24}{f'without ({c.kept.count})':<34}with ({c.everything.count})",
    ]
    for without, everything in zip(c.kept.fits, c.everything.fits, strict=True):
        for a, b in zip(without.estimates[:1], everything.estimates[:1], strict=True):
            name = f"{_short(without)}: "
            lines.append(f"  {name:<24}{with_error(a):<34}{with_error(b)}")
            lines.append(
                f"  {'  reduced chi²':<24}{without.reduced_chi2:<34.2f}"
                f"{everything.reduced_chi2:.3g}"
            )
    bad = [fit.curve.label for fit in c.everything.fits if not fit.converged]
    if bad:
        lines.append(f"  NOT converged with the marked pairs: {', '.join(bad)}")
    return lines


def _open_questions(c: Calibration) -> list[str]:
    lines = ["What e(v) alone cannot say"]
    for fit in c.kept.fits:
        lines.append(f"  {_short(fit)}: {fit.curve.unidentified}")
    given = c.mass is not None and c.stiffness is not None
    if not given and any(fit.curve.kind != "constant" for fit in c.kept.fits):
        lines.append("  give --stiffness for c, and --mass with it for A")
    return lines

"""Settings for each simulator, and why some cannot take the law."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..._export import Export, engines, export
from ..._text.units import quantity
from ..calibration.summary import CalibrationSummary
from .html import Html, element, joined, paragraphs, table

_EXACT = 5e-5
"""Largest error of e that is reported as negligible."""


def simulators(s: CalibrationSummary, radius: float | None, tell: Callable[[str], None]) -> Html:
    """Return the parameters for each simulator, or why they cannot be given."""
    if s.law is None:
        return paragraphs("no fit converged: there is no law to export")
    missing = [name for name in ("mass", "stiffness") if name not in s.given]
    if missing:
        words = " and ".join(f"--{name}" for name in missing)
        return paragraphs(
            "a simulator also needs the mass and the stiffness of the contact, which e(v) does "
            f"not determine: give {words} (in Python {' and '.join(missing)} of calibrate); this "
            f"section then lists the settings for {', '.join(engines())}, and e(v) does not change"
        )
    parts, refused = [], []
    for engine in engines():
        tell(f"inverting the law of {engine}")
        try:
            parts.append(_engine(_exported(s, engine, radius)))
        except ValueError as error:
            refused.append((engine, _reason(str(error))))
    return joined(
        [
            paragraphs(
                "for each simulator, the parameters with the least maximum error of e over the "
                "measured speeds"
            ),
            *parts,
            element("h3", "Not possible") if refused else "",
            table(("simulator", "why"), refused, left=2),
        ]
    )


def _exported(s: CalibrationSummary, engine: str, radius: float | None) -> Export:
    """Return the export, with the radius for the engines that take one."""
    if radius is not None:
        try:
            return export(s, engine=engine, radius=radius)
        except ValueError as error:
            if "Argument `radius`" not in str(error):
                raise
    return export(s, engine=engine)


def _reason(message: str) -> str:
    if "`radius` is needed" in message:
        return "needs the radius of the ball: give --radius (in Python radius of report)"
    return message


def _engine(found: Export) -> Html:
    speeds, error = np.atleast_1d(found.velocity), np.atleast_1d(found.error)
    rows: list[Any] = [
        (name, f"{value:.6g} {found.units[name]}".rstrip())
        for name, value in found.parameters.items()
    ]
    largest = float(np.max(np.abs(error)))
    range_of = f"{speeds.min():.3g} to {speeds.max():.3g} m/s"
    off = "below 0.0001" if largest < _EXACT else f"{largest:.4f}"
    rows.append((f"largest error of e, {range_of}", off))
    rows.append(("duration of contact", quantity("duration", f"{found.duration:.3g}")))
    if found.time_step is not None and found.expected_error is not None:
        words = f"time step, for e within {found.expected_error:.1%}"
        rows.append((words, f"{found.time_step:.2g} s"))
    else:
        rows.append(("time step", "not known"))
    return element(
        "article",
        element("h3", found.engine),
        element("p", found.model),
        element("pre", found.snippet),
        table(("", ""), rows),
        paragraphs(found.limit),
    )

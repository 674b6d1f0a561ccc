"""The figures of the page, small enough to read on a phone."""

from __future__ import annotations

import pathlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ..calibration.calibrate import Calibration
from ..recordings import tracks_of
from .html import Html, element, picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WIDTH, _HEIGHT = 4.4, 3.9
"""In inches: the width of a phone, so that text is shown at its own size."""

_SVG = pathlib.Path("picture.svg")


def pictures(calibration: Calibration) -> Html:
    """Return the curves with bands, the choice among laws, and the residuals of the best law."""
    from ...plot import calibration as curves
    from ...plot import choice, residuals

    parts = [
        picture(
            _one(lambda ax: curves(calibration, ax=ax)),
            "Measured e over the approach speed, and each law ± 2 standard errors",
        ),
        picture(
            _one(lambda ax: choice(calibration.choice, ax=ax)),
            "The laws by AICc, the best one thickest; the broad grey line is a free curve",
        ),
    ]
    if calibration.impacts:
        from ...plot import record

        parts.append(
            picture(
                _drawn(lambda f: record(calibration, ax=f.subplots(2)), 2 * _HEIGHT),
                "The record, its impacts and their fits",
            )
        )
    if tracks_of(one for pair in calibration.recorded_pairs.records for one in pair):
        from ...plot import track

        parts.append(
            picture(
                _one(lambda ax: track(calibration, ax=ax)),
                "The track, with the parabolas between impacts",
            )
        )
    best = calibration.choice.best
    if best is not None:
        fit = calibration.choice.fits[best]
        parts.append(
            picture(
                _drawn(lambda f: residuals(fit, ax=f.subplots(3)), 2 * _HEIGHT),
                f"Residuals of {best}: over the speed, in order, and against normal noise",
            )
        )
    return element("div", *parts, class_="pictures")


def _one(draw: Callable[[Any], object]) -> bytes:
    return _drawn(lambda figure: draw(figure.add_subplot()), _HEIGHT)


def _drawn(draw: Callable[[Figure], object], height: float) -> bytes:
    from ...plot._drawing.save import render

    return render(draw, (_WIDTH, height), _SVG)

"""Reproducible image files."""

from __future__ import annotations

import io
import os
import pathlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._entry import Range, as_array, refusal, require_number, require_path
from ..._text.files import FIGURES, write_all

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI = Range(low=10.0, high=10_000.0, inside=200.0)
"""Fonts have no size below the lower limit."""

_METADATA: dict[str, dict[str, None]] = {
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "ModDate": None, "Producer": None, "Creator": None},
    "svg": {"Date": None, "Creator": None},
}
"""Metadata that depend on the time or the release are omitted."""

_FILES: dict[Any, Any] = {
    # Ids from the content instead of random ones.
    "svg.hashsalt": "jaxcontact",
    # Letters as outlines look the same where the font is missing.
    "svg.fonttype": "path",
    # TrueType: journals refuse Type 3 fonts.
    "pdf.fonttype": 42,
}


def save(ax: Any, file: str | os.PathLike[str], *, dpi: float = 200.0) -> None:
    """Write the figure of the given axes; the same axes always give the same bytes.

    SVG and PDF contain letters as outlines or TrueType, and no date. Arguments: axes, or an array
    of them; the name of the `file`, which ends in .png, .pdf or .svg and is written completely or
    not at all; the resolution of raster parts in dots per inch, from 10 to 10,000. Raises
    ValueError for anything but axes, another ending and arguments out of range, OSError if writing
    fails.
    """
    path = require_path("file", file)
    dpi = require_number("dpi", dpi, _DPI)
    if path.suffix.lower() not in FIGURES:
        raise refusal("file", f"end in {', '.join(FIGURES[:-1])} or {FIGURES[-1]}", file)
    write_all({path: image_of(_figure_of(ax), path.suffix[1:].lower(), dpi=dpi)})


def _figure_of(value: Any) -> Figure:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    array = as_array(value, object) if isinstance(value, np.ndarray | list | tuple) else None
    first = array.flat[0] if array is not None and array.size else value
    figure = first.get_figure(root=True) if isinstance(first, Axes) else None
    if not isinstance(figure, Figure):
        raise refusal("ax", "be axes of a figure", value)
    return figure


def render(
    draw: Callable[[Figure], object], size: tuple[float, float], file: pathlib.Path
) -> bytes:
    """Return a figure of the `size` in inches, filled by `draw`, in the format of the file name."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    # Its own canvas needs no display and does not change the user's backend.
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    draw(figure)
    return image_of(figure, file.suffix[1:].lower())


def image_of(figure: Figure, form: str, *, dpi: float = 200.0) -> bytes:
    """Return a figure as a file of the format "png", "pdf" or "svg"."""
    import matplotlib as mpl

    stream = io.BytesIO()
    with mpl.rc_context(_FILES):
        figure.savefig(stream, format=form, dpi=dpi, metadata=_METADATA[form])
    return stream.getvalue()

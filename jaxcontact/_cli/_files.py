"""Output files of the commands: their names, and figures as bytes."""

from __future__ import annotations

import io
import pathlib
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from .._whole_files import is_special
from ._options import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES = (".png", ".pdf", ".svg")
"""What a figure may be written as."""


def output_path(option: str, name: str, suffixes: Sequence[str]) -> pathlib.Path:
    """The file to write. Raises InputError unless its name ends in one of `suffixes`."""
    path = pathlib.Path(name)
    if path.suffix.lower() not in suffixes:
        allowed = " or ".join([", ".join(suffixes[:-1]), suffixes[-1]])
        raise InputError(f"{option} {name}: the name must end in {allowed}")
    if is_special(path):
        kind = "folder" if path.is_dir() else "pipe or a device"
        raise InputError(f"{option} {name}: is a {kind}")
    return path


def drawn(draw: Callable[[Figure], object], size: tuple[float, float], file: pathlib.Path) -> bytes:
    """A figure of the `size` in inches, filled by `draw`, in the form that the file's name says."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    # Its own canvas needs no display and leaves the user's choice of backend alone.
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    draw(figure)
    return image_of(figure, file.suffix[1:].lower())


def image_of(figure: Figure, form: str, **metadata: None) -> bytes:
    """A figure as a file of the form "png", say; `metadata` of None are left out."""
    stream = io.BytesIO()
    figure.savefig(stream, format=form, dpi=200, metadata=metadata)
    return stream.getvalue()

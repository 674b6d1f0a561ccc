"""Saving calibrations to a file, and loading them."""

from __future__ import annotations

import os

import jax

from ..._parameter import require_path
from ..._text.files import read_whole, write_all
from .as_json import FormatError, dumps, loads
from .summary import CalibrationSummary

VERSION = 5
"""Version of the file format; raised when a field is added, removed or changes its meaning."""


def to_json(summary: CalibrationSummary) -> str:
    """Return a calibration as file text; raise ValueError for a number that is not finite."""
    return dumps(summary, VERSION)


def save(summary: CalibrationSummary, path: str | os.PathLike[str]) -> None:
    """Write a calibration as JSON, completely or not at all; raise OSError if that fails."""
    write_all({require_path("path", path): to_json(summary).encode()})


def load_calibration(path: str | os.PathLike[str]) -> CalibrationSummary:
    """Load the calibration that `Calibration.save` wrote, every number to its last bit.

    Returns a `CalibrationSummary` as plain data: `.law`, `.contact`, `.standard_errors`, `.choice`
    and all other results. Raises ValueError, which names file and field, for an unknown format
    version, an unknown or missing field, an unknown law, and a number that is missing or not
    finite. Raises ValueError for an invalid path, and OSError for a file that cannot be read.
    """
    file = require_path("path", path)
    try:
        with jax.enable_x64(True):
            return loads(read_whole(file).decode("utf-8"), CalibrationSummary, VERSION)
    except (FormatError, UnicodeDecodeError) as error:
        raise ValueError(f"{file}: {error}") from error

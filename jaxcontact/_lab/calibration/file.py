"""Calibrations saved to and loaded from a file."""

from __future__ import annotations

import os

import jax

from ..._parameter import require_path
from ..._text.files import read_whole, write_all
from .as_json import FormatError, dumps, loads
from .summary import CalibrationSummary

VERSION = 5
"""Of the file's format; raised whenever a field is added, removed or changes its meaning."""


def to_json(summary: CalibrationSummary) -> str:
    """A calibration as the text of a file; ValueError for a number that is not finite."""
    return dumps(summary, VERSION)


def save(summary: CalibrationSummary, path: str | os.PathLike[str]) -> None:
    """Write a calibration as JSON, whole or not at all; OSError where that fails."""
    write_all({require_path("path", path): to_json(summary).encode()})


def load_calibration(path: str | os.PathLike[str]) -> CalibrationSummary:
    """The calibration that `Calibration.save` wrote, every number to its last bit.

    Returns a `CalibrationSummary`: `.law`, `.contact`, `.standard_errors`, `.choice` and all else
    that was found, as plain data. Raises ValueError that names the file and the field for an
    unknown format version, an unknown or missing field, an unknown law, a number that is missing or
    not finite, and for what is no path; OSError for a file that cannot be read.
    """
    file = require_path("path", path)
    try:
        with jax.enable_x64(True):
            return loads(read_whole(file).decode("utf-8"), CalibrationSummary, VERSION)
    except (FormatError, UnicodeDecodeError) as error:
        raise ValueError(f"{file}: {error}") from error

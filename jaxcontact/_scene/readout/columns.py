"""Columns of numbers and words as CSV text."""

from __future__ import annotations

import csv
import functools
import io
import os
from collections.abc import Mapping
from typing import Any, BinaryIO, TextIO, cast

import numpy as np

from ..._entry import require_path
from ..._text.files import write_all


def write_csv(
    columns: Mapping[str, np.ndarray], path: str | os.PathLike[str] | TextIO | BinaryIO
) -> None:
    """Write columns (K,) with a header to a path or an open file. A named file appears whole or not
    at all. Every number is the shortest text that reads back to it, in its own precision. Raises
    ValueError if `path` is neither a path nor an open file.
    """
    if not hasattr(path, "write"):
        write_all({require_path("path", path): functools.partial(write_csv, columns)})
        return
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    texts = (np.asarray(column).astype(str).tolist() for column in columns.values())
    writer.writerows(zip(*texts, strict=True))
    binary = isinstance(path, io.BufferedIOBase | io.RawIOBase)
    cast(Any, path).write(text.getvalue().encode() if binary else text.getvalue())

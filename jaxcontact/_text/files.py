"""Files that are written and read completely or not at all."""

from __future__ import annotations

import contextlib
import os
import pathlib
import tempfile
from collections.abc import Callable, Mapping
from typing import BinaryIO

FIGURES = (".png", ".pdf", ".svg")
"""File formats of a figure."""

MOST_BYTES = 256 * 2**20
"""Limit for any table or description; keeps a mistaken file out of memory."""


def read_whole(path: pathlib.Path) -> bytes:
    """Return all bytes of a file; raise ValueError, without reading it, above `MOST_BYTES`."""
    with path.open("rb") as file:
        # A device has no size to check in advance.
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise ValueError(
            f"{path} must hold at most {MOST_BYTES // 2**20} MiB, but holds more; give the part of "
            "it that matters, or arrays by keyword."
        )
    return content


def is_special(path: pathlib.Path) -> bool:
    """Return whether the name is a folder, a pipe or a device, which a file cannot replace."""
    return path.exists() and not path.is_file()


def write_all(contents: Mapping[pathlib.Path, bytes | Callable[[BinaryIO], object]]) -> None:
    """Write all files completely: each to a temporary file beside it first, then renamed.

    A content is bytes, or a function that writes them. Missing folders are created. Nothing is
    renamed before everything is written; the temporary files are removed if anything fails. Raises
    OSError, also if a name is that of a folder, a pipe or a device.
    """
    for path in contents:
        if is_special(path):
            raise FileExistsError(
                f"{path} must be a regular file, but is a folder, a pipe or a device"
            )
    temporary: dict[pathlib.Path, str] = {}
    try:
        for path, content in contents.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".tmp")
            temporary[path] = name
            with os.fdopen(handle, "wb") as file:
                if callable(content):
                    content(file)
                else:
                    file.write(content)
            # mkstemp makes files that only their owner may read; restore the usual permissions.
            mask = os.umask(0)
            os.umask(mask)
            os.chmod(name, 0o666 & ~mask)
        for path in contents:
            os.replace(temporary[path], path)
            del temporary[path]
    finally:
        for name in temporary.values():
            with contextlib.suppress(FileNotFoundError):
                os.unlink(name)

"""Files that appear whole or not at all, and are read whole or not at all."""

from __future__ import annotations

import contextlib
import os
import pathlib
import tempfile
from collections.abc import Callable, Mapping
from typing import BinaryIO

FIGURES = (".png", ".pdf", ".svg")
"""What a figure may be written as."""

MOST_BYTES = 256 * 2**20
"""More than any table or description holds: a mistaken file stays out of memory."""


def read_whole(path: pathlib.Path) -> bytes:
    """All bytes of a file; ValueError for one of more than `MOST_BYTES`, which are not read."""
    with path.open("rb") as file:
        # A device has no size that could be looked at before.
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise ValueError(
            f"{path} must hold at most {MOST_BYTES // 2**20} MiB, but holds more; give the part of "
            "it that matters, or arrays by keyword."
        )
    return content


def is_special(path: pathlib.Path) -> bool:
    """Whether there is a folder, a pipe or a device of this name, which no file can replace."""
    return path.exists() and not path.is_file()


def write_all(contents: Mapping[pathlib.Path, bytes | Callable[[BinaryIO], object]]) -> None:
    """Write all files, each whole: to a temporary file beside it first, then renamed.

    A content is what to write, or a function that writes it. Missing folders are made. Nothing is
    renamed before everything is written; the temporary files are removed if anything fails. Raises
    OSError, also where a name is that of a folder, a pipe or a device.
    """
    for path in contents:
        if is_special(path):
            raise FileExistsError(f"{path} is a folder, a pipe or a device, no file to replace")
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
            # mkstemp makes files that only their owner may read; give them the usual rights.
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

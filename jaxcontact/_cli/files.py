"""Output files of the commands."""

from __future__ import annotations

import pathlib
from collections.abc import Sequence

from .._text.files import is_special
from .options import InputError


def output_path(option: str, name: str, suffixes: Sequence[str]) -> pathlib.Path:
    """Return the file to write; raise InputError unless its name ends in one of `suffixes`."""
    path = pathlib.Path(name)
    if path.suffix.lower() not in suffixes:
        allowed = " or ".join([*filter(None, [", ".join(suffixes[:-1])]), suffixes[-1]])
        raise InputError(f"{option} {name}: the name must end in {allowed}")
    if is_special(path):
        kind = "folder" if path.is_dir() else "pipe or a device"
        raise InputError(f"{option} {name}: is a {kind}")
    return path

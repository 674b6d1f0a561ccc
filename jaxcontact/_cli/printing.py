"""Results as JSON, with null for non-finite numbers, and output files of the commands."""

from __future__ import annotations

import json
import math
import pathlib
from collections.abc import Sequence
from typing import Any

from .._text.files import is_special
from .options import InputError


def print_json(result: Any) -> None:
    """Print a result of dicts, lists, texts, numbers and arrays."""
    print(json.dumps(plain(result), indent=1, ensure_ascii=False, allow_nan=False))


def plain(value: Any) -> Any:
    """Convert arrays to lists, numbers to Python's, and non-finite ones to None."""
    if isinstance(value, dict):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    import numpy as np

    # The remaining values are arrays and numbers of NumPy and JAX.
    return plain(np.asarray(value).tolist())


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

"""Flags, names and objects on entry."""

from __future__ import annotations

import difflib
import os
import pathlib
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import jax
import numpy as np
from jax.core import Tracer

from .words import rendered

Kind = TypeVar("Kind")


def as_flag(value: Any) -> bool | None:
    """Convert a Python, NumPy or JAX flag to True or False; None for anything else."""
    if isinstance(value, np.ndarray | np.generic | jax.Array):
        plain = not isinstance(value, Tracer | np.ma.MaskedArray) and value.ndim == 0
        value = value.item() if plain and value.dtype == bool else None
    return value if isinstance(value, bool) else None


def require_flag(name: str, value: Any) -> bool:
    """Convert a flag to True or False; ValueError for anything else."""
    flag = as_flag(value)
    if flag is None:
        raise ValueError(f"Argument `{name}` must be True or False, but is {rendered(value)}.")
    return flag


def require_choice(name: str, value: Any, choices: Iterable[str]) -> str:
    """Return `value` if it is one of a few names; otherwise ValueError lists them."""
    known = tuple(choices)
    if not isinstance(value, str) or value not in known:
        raise ValueError(
            f"Argument `{name}` must be one of {', '.join(map(repr, known))}, "
            f"but is {rendered(value)}.{did_you_mean(value, known)}"
        )
    return value


def nearest(given: Any, known: Iterable[str]) -> str | None:
    """Return the known name that is most similar to a misspelt one; None without a close match."""
    if not isinstance(given, str):
        return None
    folded = {name.casefold(): name for name in known}
    found = difflib.get_close_matches(given.casefold(), folded, n=1)
    return folded[found[0]] if found else None


def did_you_mean(given: Any, known: Iterable[str]) -> str:
    """Return a suggestion for the end of a message, with a leading blank; "" without a match."""
    near = nearest(given, known)
    return f" Did you mean {near!r}?" if near else ""


def require_kind(name: str, value: Any, kind: type[Kind], allowed: str) -> Kind:
    """Return `value` if it is an instance of `kind`; ValueError names `allowed` otherwise."""
    if not isinstance(value, kind):
        raise ValueError(f"Argument `{name}` must be {allowed}, but is {rendered(value)}.")
    return value


def require_function(name: str, value: Any) -> Callable[..., Any]:
    """Return `value` if it is callable; ValueError for anything else."""
    if not callable(value):
        raise ValueError(f"Argument `{name}` must be a function, but is {rendered(value)}.")
    return value


def require_path(name: str, value: Any) -> pathlib.Path:
    """Return the path of a file; ValueError for anything but text or an `os.PathLike`."""
    text = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(text, str) or not text or "\0" in text:
        raise ValueError(f"Argument `{name}` must be the path of a file, but is {rendered(value)}.")
    return pathlib.Path(text)

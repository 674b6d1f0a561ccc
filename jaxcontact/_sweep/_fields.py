"""The named fields of what a function returns, and the arrays in them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

VALUE = "value"
"""The name of the only field of an output that has no names."""


@dataclass(frozen=True, eq=False)
class Field:
    """One field of an output: the names of its arrays, or a constant where it holds none."""

    name: str
    arrays: tuple[str, ...] = ()
    """The name of the field itself where it is one array."""
    structure: Any = None
    """How the arrays make up the field."""
    constant: Any = None


def fields_of(output: Any) -> tuple[list[Field], dict[str, Any]]:
    """The fields of one lane's output, and its arrays by name.

    Fields without arrays (None, what is static) are kept as they are.
    """
    fields: list[Field] = []
    arrays: dict[str, Any] = {}
    for name, value in _named(output):
        paths, structure = jax.tree_util.tree_flatten_with_path(value)
        found = {name + jax.tree_util.keystr(path): leaf for path, leaf in paths}
        if found and all(map(_is_number, found.values())):
            fields.append(Field(name, tuple(found), structure))
            arrays |= found
        else:
            fields.append(Field(name, constant=value))
    return fields, arrays


def _named(output: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(output, Mapping):
        yield from ((str(name), value) for name, value in output.items())
    elif isinstance(output, tuple) and hasattr(output, "_asdict"):
        yield from output._asdict().items()  # pyright: ignore[reportAttributeAccessIssue]
    elif dataclasses.is_dataclass(output) and not isinstance(output, type):
        for field in dataclasses.fields(output):
            yield field.name, getattr(output, field.name)
    else:
        yield VALUE, output


def _is_number(leaf: Any) -> bool:
    return isinstance(leaf, jax.Array | np.ndarray | np.generic | float | int | bool)

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
    """One field of an output: numbers of leaves, or a constant where it holds no array."""

    name: str
    leaves: tuple[int, ...]
    structure: Any
    """How the leaves make up the field; None if the field is one array."""
    constant: Any = None

    def leaf_names(self) -> list[str]:
        """A name for every leaf: that of the field where it is one array."""
        if self.structure is None:
            return [self.name] if self.leaves else []
        paths = jax.tree_util.tree_leaves_with_path(
            jax.tree.unflatten(self.structure, range(len(self.leaves)))
        )
        return [self.name + jax.tree_util.keystr(path) for path, _ in paths]


def fields_of(output: Any) -> tuple[list[Field], list[Any]]:
    """The fields of one lane's output, and its arrays in order.

    Fields without arrays (None, what is static) are kept as they are.
    """
    fields, arrays = [], []
    for name, value in _named(output):
        leaves, structure = jax.tree.flatten(value)
        if not leaves or not all(map(_is_number, leaves)):
            fields.append(Field(name, (), None, value))
            continue
        numbers = tuple(range(len(arrays), len(arrays) + len(leaves)))
        alone = jax.tree.structure(0) == structure
        fields.append(Field(name, numbers, None if alone else structure))
        arrays += leaves
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

"""One value for all pairs of bodies, or a table by the names of the pair."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import equinox as eqx

from ..._entry import rendered

DEFAULT = "default"
"""The key of the entry for all pairs that are not named."""


class PairTable(eqx.Module):
    """Values by pair: `table[a][b]` is the index in `values` for bodies of kinds a and b. The kind
    of a body is its name; all unnamed bodies are one kind. -1 marks pairs without a value.
    """

    values: tuple[Any, ...]
    table: tuple[tuple[int, ...], ...] = eqx.field(static=True)

    @property
    def alike(self) -> bool:
        """True if one value serves all pairs."""
        return len(self.values) == 1 and all(k == 0 for row in self.table for k in row)


def kinds_of(names: Sequence[str | None]) -> tuple[tuple[str | None, ...], tuple[int, ...]]:
    """Return the distinct names in order, and the kind of each body."""
    different = tuple(dict.fromkeys(names))
    return different, tuple(different.index(name) for name in names)


def pair_table(
    argument: str,
    given: Any,
    check: Callable[[str, Any], Any],
    kinds: Sequence[str | None],
    meeting: Sequence[tuple[int, int]],
) -> PairTable:
    """Return the table of an argument: one value for all pairs, or a mapping by names.

    The names of a pair may be in either order. `check` converts a value, and `meeting` lists the
    pairs of kinds that may meet. Raises ValueError for unknown names, pairs given twice, and pairs
    that meet without a value.
    """
    count = len(kinds)
    if not isinstance(given, Mapping):
        value = check(argument, given)
        return PairTable((value,), tuple((0,) * count for _ in range(count)))
    if not given:
        raise ValueError(f"Argument `{argument}` must have an entry, but is {rendered(given)}.")
    default, rows = -1, [[-1] * count for _ in range(count)]
    for place, key in enumerate(given):
        if isinstance(key, str) and key == DEFAULT:
            default = place
            continue
        a, b = _kinds_named(argument, key, kinds)
        if rows[a][b] >= 0:
            raise ValueError(
                f"Argument `{argument}` must name a pair once, but names {key} in both orders."
            )
        rows[a][b] = rows[b][a] = place
    values = [check(argument, entry) for entry in given.values()]
    table = tuple(tuple(default if k < 0 else k for k in row) for row in rows)
    for a, b in meeting:
        if table[a][b] < 0:
            first, second = (
                "an unnamed body" if kinds[k] is None else repr(kinds[k]) for k in (a, b)
            )
            raise ValueError(
                f"Argument `{argument}` must have an entry for {first} and {second}, which can "
                f"meet, or a 'default', but is {rendered(given)}."
            )
    return PairTable(tuple(values), table)


def _kinds_named(argument: str, key: Any, kinds: Sequence[str | None]) -> tuple[int, int]:
    """Return the kinds of a pair of names; raises ValueError for anything else."""
    if not (isinstance(key, tuple) and len(key) == 2 and all(isinstance(k, str) for k in key)):
        raise ValueError(
            f"Argument `{argument}` must have pairs of names, such as ('ball', 'table'), or "
            f"'default' as its keys, but has {rendered(key)}."
        )
    for name in key:
        if name not in kinds:
            listed = ", ".join(repr(kind) for kind in kinds if kind is not None) or "none"
            raise ValueError(
                f"Argument `{argument}` must name bodies of the scene ({listed}), but names "
                f"{name!r}."
            )
    return kinds.index(key[0]), kinds.index(key[1])

"""Words for counts, lists and ranges."""

from __future__ import annotations

from collections.abc import Sequence

Words = tuple[str, str]
"""A noun phrase in the singular and in the plural."""


def counted(count: int, words: Words) -> str:
    """Return a count with its noun: `1 trial`, `2 trials`, `0 trials`."""
    return f"{count} {words[count != 1]}"


def listed(names: Sequence[str]) -> str:
    """Return names as `a, b and c`."""
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def span(values: Sequence[float], unit: str = "") -> str:
    """Return the range of values: `0.1 to 0.3 m`, or `0.1 m` if all are equal."""
    low, high = f"{min(values):.3g}", f"{max(values):.3g}"
    return f"{low if low == high else f'{low} to {high}'} {unit}".rstrip()


_NAMED = 5
"""Largest number of bad points that a message names; the others are counted."""


def first_few(words: Sequence[str]) -> str:
    """Return the first few words, and how many more there are."""
    more = f" and {len(words) - _NAMED} more" if len(words) > _NAMED else ""
    return ", ".join(words[:_NAMED]) + more

"""What several functions of a fit check about their arguments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

_NAMED = 5
"""The most bad points that a message names; of the others it gives the number."""


def at_least(name: str, value: Any, least: int) -> None:
    """Raise ValueError for what is no whole number of at least `least`."""
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        raise ValueError(f"Argument `{name}` must be at least {least}, but is {value!r}.")


def is_level(level: float) -> None:
    """Raise ValueError for what is no probability of an interval."""
    if not 0 < level < 1:
        raise ValueError(f"Argument `level` must be in (0, 1), but is {level!r}.")


def listed(words: Sequence[str]) -> str:
    """The first few words, and how many more there are."""
    more = f" and {len(words) - _NAMED} more" if len(words) > _NAMED else ""
    return ", ".join(words[:_NAMED]) + more

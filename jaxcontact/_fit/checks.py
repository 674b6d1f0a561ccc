"""Words for the messages of a fit."""

from __future__ import annotations

from collections.abc import Sequence

_NAMED = 5
"""Largest number of bad points that a message names; the others are counted."""


def listed(words: Sequence[str]) -> str:
    """Return the first few words, and how many more there are."""
    more = f" and {len(words) - _NAMED} more" if len(words) > _NAMED else ""
    return ", ".join(words[:_NAMED]) + more

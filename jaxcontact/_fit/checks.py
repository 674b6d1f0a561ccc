"""Words for the messages of a fit."""

from __future__ import annotations

from collections.abc import Sequence

_NAMED = 5
"""The most bad points that a message names; of the others it gives the number."""


def listed(words: Sequence[str]) -> str:
    """The first few words, and how many more there are."""
    more = f" and {len(words) - _NAMED} more" if len(words) > _NAMED else ""
    return ", ".join(words[:_NAMED]) + more

"""Compiled programs, kept from one command to the next."""

from __future__ import annotations

import warnings


def keep_programs() -> None:
    """Keep what is compiled for the next command.

    What cannot be written or read is compiled as if there were no store, without a word.
    """
    from .._cache import cache

    try:
        cache()
    except ValueError:
        return
    for verb in ("reading", "writing"):
        warnings.filterwarnings("ignore", f"Error {verb} persistent compilation cache entry")

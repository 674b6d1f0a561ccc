"""Compiled programs, kept from one command to the next."""

from __future__ import annotations

import warnings


def keep_programs() -> None:
    """Keep compiled programs for the next command.

    Programs that cannot be written or read are compiled as without a cache, without a message.
    """
    from .._cache import cache

    try:
        cache()
    except ValueError:
        return
    for verb in ("reading", "writing"):
        warnings.filterwarnings("ignore", f"Error {verb} persistent compilation cache entry")

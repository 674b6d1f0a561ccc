"""The name of a law in a table."""

from __future__ import annotations

from .._laws import AbstractLaw, describe, list_laws


def column(law: type[AbstractLaw]) -> str:
    """The registered name of a law, as `get_law` takes it."""
    return next(name for name in list_laws() if describe(name).cls is law)

"""Where a mechanism starts."""

from __future__ import annotations

from typing import TypedDict

from jaxtyping import Array, Float


class SystemStart(TypedDict):
    """The start of a mechanism, as `simulate` takes it: `simulate(system, duration, **start)`."""

    position: Float[Array, " n"]
    velocity: Float[Array, " n"]

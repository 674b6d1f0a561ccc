"""What a run writes down: one row an impact, with the bodies before and after it."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ._hit import Choice, Flying, Outcome


class Figures(NamedTuple):
    """The numbers of the rows, which have derivatives."""

    before: Flying
    outcome: Outcome


class Facts(NamedTuple):
    """The decisions of the rows: what met, what each body rests on after it, how it was solved.

    `tied`: whether another impact competed with this one at the same time; `rival`, the time until
    the next event of either body would have been, or since its last one, in s.
    """

    choice: Choice
    support: Int[Array, "K 2"]
    tied: Any
    rival: Float[Array, " K"]


class Log(NamedTuple):
    """The rows of a run; those from `count` on are blank."""

    figures: Figures
    facts: Facts


def blank_log(rows: int, dimensions: int, dtype: Any) -> Log:
    """A log with room for so many rows."""
    vector = jnp.zeros((rows, 2, dimensions), dtype)
    pair, one = jnp.zeros((rows, 2), dtype), jnp.zeros(rows, dtype)
    flying = Flying(vector, vector, pair)
    whole = jnp.zeros(rows, int)
    choice = Choice(
        whole, whole, jnp.zeros((rows, 2), int) - 1, vector[:, 0], one, jnp.zeros(rows, bool)
    )
    facts = Facts(choice, jnp.zeros((rows, 2), int) - 1, jnp.zeros(rows, bool), one)
    return Log(Figures(flying, Outcome(flying, one, one, one, one, one)), facts)

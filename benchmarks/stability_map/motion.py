"""A scaled impact as input of the oracle, and its outcome."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .collocation import EXTENDED, Array

SEPARATED, SETTLED, UNANSWERED = 0, 1, 2


@dataclass
class Problem:
    """Scaled impacts. `tension`: lasts until x = 0; `approach`: damped until the turn."""

    c: Array
    p: Array
    n: Array
    push: Array
    tension: Array
    approach: Array

    def __post_init__(self) -> None:
        shape = np.broadcast_shapes(*(np.shape(getattr(self, f.name)) for f in fields(self)))
        for field in fields(self):
            kind = bool if field.name in ("tension", "approach") else EXTENDED
            value = np.broadcast_to(np.asarray(getattr(self, field.name), kind), shape)
            setattr(self, field.name, value.reshape(-1).copy())

    def __len__(self) -> int:
        return self.c.size

    def at(self, index: Array) -> Problem:
        return Problem(*(getattr(self, f.name)[index] for f in fields(self)))


@dataclass
class Truth:
    """Outcomes in scaled units; `largest` is the largest energy of the motion, beside 1/2."""

    status: Array
    e: Array
    duration: Array
    compression_time: Array
    max_indentation: Array
    max_force: Array
    loss: Array
    largest: Array
    steps: Array

    @classmethod
    def empty(cls, count: int) -> Truth:
        numbers = {f.name: np.full(count, np.nan, EXTENDED) for f in fields(cls)}
        numbers["status"] = np.full(count, UNANSWERED)
        numbers["steps"] = np.zeros(count, int)
        return cls(**numbers)

    def put(self, index: Array, part: Truth) -> None:
        for field in fields(self):
            getattr(self, field.name)[index] = getattr(part, field.name)


QUANTITIES = ("e", "duration", "compression_time", "max_indentation", "max_force")

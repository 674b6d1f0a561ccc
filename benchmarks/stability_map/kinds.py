"""A scaled impact as input of the oracle, its outcome, and the kinds of contact force: their data
for the oracles, and the construction of their laws.
"""

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


@dataclass(frozen=True)
class Kind:
    """A force `x^(n-p) (x^p + c v)`.

    `family`: "hunt_crossley" (p = 0, c = α), "kuwabara_kono" (p = 1, c = n a) or "oscillator"
    (p = (n+1)/2, c = 2ζ √((n+1)/2)). `strongest`: the largest damping number, e = 1e-6.
    """

    name: str
    family: str
    tension: bool
    strongest: float
    approach: bool = False

    def problem(self, damping: Array, n: Array, push: Array | float) -> Problem:
        damping, n = np.asarray(damping, EXTENDED), np.asarray(n, EXTENDED)
        if self.family == "hunt_crossley":
            c, p = damping, 0 * n
        elif self.family == "kuwabara_kono":
            c, p = n * damping, 1 + 0 * n
        else:
            c, p = damping * np.sqrt(2 * (n + 1)), (n + 1) / 2
        return Problem(c, p, n, push, self.tension, self.approach)

    @property
    def ends_at_critical(self) -> bool:
        """Whether a free contact ends only below critical damping."""
        return self.family == "oscillator" and self.tension and not self.approach

    @property
    def ends_at_touch(self) -> bool:
        """Whether a free contact ends at x = 0, and is smooth in its damping from zero on."""
        return self.family == "hunt_crossley" or self.tension or self.approach

    def has_table(self, exponent: float | None) -> bool:
        """Whether free impacts are smooth enough in what varies for a table (see `free_table`).

        Near n = 1 the largest force of oscillators is not: its place moves to touch with n - 1.
        """
        return self.family == "hunt_crossley" or (
            self.family == "oscillator" and exponent is not None
        )

    def to_free(self, damping: Array) -> tuple[Array, Array]:
        """A number y ≥ 0 in whose logarithm outcomes are smooth, and d ln y/d ln damping."""
        if not self.ends_at_critical:
            return damping, np.ones_like(damping)
        below = (1 - damping) * (1 + damping)
        return damping / np.sqrt(below), 1 / below

    def from_free(self, y: Array) -> Array:
        return y / np.sqrt(1 + y * y) if self.ends_at_critical else y


KINDS = {
    kind.name: kind
    for kind in (
        Kind("hunt_crossley", "hunt_crossley", False, 1e6),
        Kind("hunt_crossley_tension", "hunt_crossley", True, 1e6),
        Kind("kuwabara_kono", "kuwabara_kono", True, 1e6),
        Kind("kuwabara_kono_clamped", "kuwabara_kono", False, 1e6),
        Kind("oscillator", "oscillator", True, 0.9751),
        Kind("oscillator_clamped", "oscillator", False, 500.0),
        Kind("oscillator_approach", "oscillator", True, 5.6e5, approach=True),
    )
}

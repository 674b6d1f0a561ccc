"""A method of solving a problem, for the tables: a name, a series of settings, and a solver."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .measure import NotPossibleError

Solve = Callable[[float], Any]
"""From a setting (a tolerance, a number of steps) to the answer for all lanes."""
LADDER = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)


@dataclass(frozen=True)
class Way:
    """`build(task, lanes, **options)` prepares a batch and returns its solver.

    `family`: who answers ("ours", "diffrax", "scipy", "numba", "engines"). `settings`: the ladder,
    named by `word`. `variants`: its options by name, of which a sweep chooses; the first one is the
    default. `most`: lanes of a batch that are measured; a larger batch is scaled from them.
    `needs`: a library it cannot do without. `compiled`: whether a first call compiles.
    """

    name: str
    family: str
    build: Callable[..., Solve]
    settings: tuple[float, ...] = LADDER
    word: str = "rtol"
    variants: dict[str, dict[str, Any]] = field(default_factory=lambda: {"": {}})
    most: int = 100_000
    needs: str = ""
    compiled: bool = True
    batches: tuple[int, ...] | None = None
    """Batches it is meant for; None for all."""
    files: tuple[str, ...] = ()
    """Files of its own, beside those of its family."""

    def prepared(self, task: Any, lanes: np.ndarray, variant: str) -> Solve:
        """The solver of a batch; NotPossibleError with the reason where there is none."""
        if self.needs and importlib.util.find_spec(self.needs) is None:
            raise NotPossibleError(f"{self.needs} is not installed")
        try:
            return self.build(task, lanes, **self.variants[variant])
        except ValueError as error:
            # The package states what a law or a motion lacks.
            raise NotPossibleError(str(error).split(": ", 1)[-1]) from error

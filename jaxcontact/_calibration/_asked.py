"""The parameter e with which each law of constant restitution delivers a given one."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._impact import restitution
from .._laws import AbstractLaw, constant_laws, describe

_GRID = 1001
"""Points of a grid, refined in one of its cells: a straight line between two is good to 1e-12."""


@dataclasses.dataclass(frozen=True)
class Asked:
    """A law, the e to set in it, and its standard error; None where the law cannot deliver.

    `least` and `most` are what the law delivers at the ends of its range.
    """

    law: str
    e: float | None
    standard_error: float | None
    least: float
    most: float

    @property
    def sentence(self) -> str:
        """The law, and the e to set."""
        if self.e is None:
            return f"{self.law:20} cannot: it delivers {self.least:.3g} to {self.most:.3g}"
        error = "" if self.standard_error is None else f" ± {self.standard_error:.2g}"
        return f"{self.law:20} {self.e:.5f}{error}"


def asked_of(delivered: float, standard_error: float | None) -> tuple[Asked, ...]:
    """The e to set in each law so that it delivers the restitution `delivered` ± `standard_error`.

    At a constant e every law has one equivalent in every other: e(v) cannot distinguish them, and
    the choice among them is one of convenience or of the contact's duration. A registered law of
    one parameter e is left out if what it delivers depends on more, or does not rise with e.
    """
    names = [name for name in constant_laws() if _is_constant(describe(name).cls)]
    with jax.enable_x64(True):
        # 0 itself may be out of range; no real e is so small.
        low, high = np.full(len(names), np.finfo(np.float32).tiny), np.ones(len(names))
        place, e = _on_grid(names, low, high)
        rising = np.all(np.diff(e) > 0, axis=1)
        names = [name for name, rises in zip(names, rising, strict=True) if rises]
        place, e = place[rising], e[rising]
        ends = e[:, [0, -1]]
        low, high = _around(place, e, delivered)[:2]
        place, e = _on_grid(names, low, high)
    low, high, before, after = _around(place, e, delivered)
    slope = (after - before) / (high - low)
    asked = low + (delivered - before) / slope
    found = []
    for k, name in enumerate(names):
        least, most = (float(end) for end in ends[k])
        within = least <= delivered <= most
        error = None
        if within and standard_error is not None:
            error = standard_error / float(slope[k])
        found.append(Asked(name, float(asked[k]) if within else None, error, least, most))
    return tuple(found)


def _around(place: np.ndarray, e: np.ndarray, delivered: float) -> tuple[np.ndarray, ...]:
    """The ends of the cell of each law's grid that holds `delivered`, and what they deliver."""
    rows = np.arange(len(e))
    cell = np.clip(np.sum(e < delivered, axis=1), 1, _GRID - 1)
    return place[rows, cell - 1], place[rows, cell], e[rows, cell - 1], e[rows, cell]


def _on_grid(names: list[str], low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points between `low` and `high` (laws,), and what each law delivers there."""
    place = np.linspace(low, high, _GRID, axis=1)
    # By class: a name may be registered anew.
    classes = tuple(describe(name).cls for name in names)
    return place, np.asarray(_delivered(classes, jnp.asarray(place)))


@functools.partial(jax.jit, static_argnums=0)
def _delivered(
    classes: tuple[Callable[..., AbstractLaw], ...], e: Float[Array, "laws n"]
) -> Float[Array, "laws n"]:
    return jnp.stack([restitution(law(e=row)) for law, row in zip(classes, e, strict=True)])


def _is_constant(law: Callable[..., AbstractLaw]) -> bool:
    """Whether e depends neither on the contact nor on the speed."""
    try:
        jax.eval_shape(lambda e: restitution(law(e=e)), 0.5)
    except (TypeError, ValueError):  # it needs the contact or the speed
        return False
    return True

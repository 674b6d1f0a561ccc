"""The choice of the friction law that describes measured oblique impacts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Unpack

import jax
import numpy as np
from jaxtyping import ArrayLike, Bool

from ..._contact import Contact
from ..._fit import Fit, compared, undecided
from ..._fit.keywords import SearchKeywords, takes
from ..._friction import AbstractFriction
from ..._impact import RoundBodies
from ..._laws import AbstractLaw
from ..._text.progress import stages_of
from ..._text.words import counted
from .candidates import candidates_of
from .fit_oblique import columns_of, fitted
from .friction_choice import FrictionChoice, said
from .measurements import Measurements, measurements
from .next_angle import next_angle

_FOLDS = 4
_ROUNDS = 2
_SPARE = 3
_NUMBERS = "number", "numbers"


@takes(SearchKeywords, noise=None)
def choose_friction(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    tangential_velocity: ArrayLike,
    *,
    friction: Mapping[str, AbstractFriction] | None = None,
    tangential_restitution: ArrayLike | None = None,
    rebound_angle: ArrayLike | None = None,
    rebound_spin: ArrayLike | None = None,
    sigma_tangential_restitution: ArrayLike | None = None,
    sigma_rebound_angle: ArrayLike | None = None,
    sigma_rebound_spin: ArrayLike | None = None,
    bodies: RoundBodies | str | None = None,
    progress: bool | Callable[[str], None] | None = None,
    **how: Unpack[SearchKeywords],
) -> FrictionChoice:
    """Fit several friction laws to the rebounds of oblique impacts, and choose one.

    Arguments: `friction`, the laws by name, or None for rigid Coulomb, Walton and
    Maw-Barber-Fawcett, whose tangential ratio is that of the contact; without one it is fitted. A
    law without a formula for the contact is left out. Those of discrete element codes are compared
    if they are named, as `{"force": jc.SpringSlider(0.2), ...}`; each takes long to compile.
    `progress` as in `choose_law`. All others as in `fit_oblique`.

    Without standard deviations the noise of each column is that of the residuals of the law that
    fits best. The comparison is that of `compare_fits`. Its held-out error leaves out every fourth
    angle in turn. A law is a rival if its AICc is less than 2 above the lowest.

    Returns a `FrictionChoice`, which prints μ with its error, a verdict and a table. Raises
    ValueError as `fit_oblique` does.

    Source: Burnham & Anderson (2002), doi 10.1007/b97636.
    """
    columns = columns_of(
        (tangential_restitution, sigma_tangential_restitution),
        (rebound_angle, sigma_rebound_angle),
        (rebound_spin, sigma_rebound_spin),
    )
    there = measurements(law, contact, velocity, tangential_velocity, bodies, columns)
    laws, left_out = candidates_of(friction, there)
    _require_enough(laws, there)
    tell, options = stages_of(progress), dict(how)
    reweighs = options.get("noise") is None
    options["noise"] = "common" if reweighs else options["noise"]
    fits = _fits(laws, there, options, tell)
    if reweighs and len(there.table["data"]) > 1 and "sigma" not in there.table:
        for _ in range(_ROUNDS):
            there = there.reweighed(_best_residuals(fits))
            fits = _fits(laws, there, options, lambda text: None)
    comparison = compared(
        fits,
        _parts(there),
        parameters=lambda name: said(fits[name]),
        left_out="impacts",
        group="impact",
    )
    equal = [c.name for c in undecided(comparison.candidates, next(iter(fits.values())))]
    rivals = tuple(name for name in equal if name != comparison.best)
    where = ""
    if comparison.best is not None and all(np.ndim(leaf) == 0 for leaf in jax.tree.leaves(law)):
        where = next_angle(fits[comparison.best], [fits[name] for name in rivals], there)
    return FrictionChoice(
        candidates=comparison.candidates,
        best=comparison.best,
        verdict=comparison.verdict,
        rivals=rivals,
        fits=fits,
        next_measurement=where,
        left_out=left_out,
    )


def _require_enough(laws: Mapping[str, AbstractFriction], there: Measurements) -> None:
    """Raise ValueError for fewer readings than the criterion for small samples needs."""
    most = max(sum(map(np.size, jax.tree.leaves(law))) for law in laws.values())
    count = sum(int((factor > 0).sum()) for factor in there.factor.values())
    if count < most + _SPARE:
        held = " and ".join(f"`{name}`" for name in there.table["data"])
        raise ValueError(
            f"Argument {held} must hold at least {most + _SPARE} readings to compare friction laws "
            f"of up to {counted(most, _NUMBERS)}, but holds {count}; `fit_oblique` fits one law."
        )


def _fits(
    laws: Mapping[str, AbstractFriction],
    there: Measurements,
    options: dict[str, Any],
    tell: Callable[[str], None],
) -> dict[str, Fit]:
    fits = {}
    for name, law in laws.items():
        tell(f"fitting {name}")
        fits[name] = fitted(law, there, options | {"throw": False})
    return fits


def _best_residuals(fits: Mapping[str, Fit]) -> np.ndarray:
    """Return the residuals of the fit with the lowest loss."""
    best = min(fits.values(), key=lambda fit: (not fit.converged, fit.loss))
    return best.residuals


def _parts(there: Measurements) -> Bool[np.ndarray, "folds n"]:
    """Return which points each fold leaves out: every fourth impact in the order of its angle."""
    slope = there.x["tangential_velocity"] / there.x["velocity"]
    rank = np.argsort(np.argsort(slope, kind="stable"))
    used = np.concatenate([there.factor[name] > 0 for name in sorted(there.factor)])
    fold = np.tile(rank % _FOLDS, len(there.factor))
    parts = (fold == np.arange(_FOLDS)[:, None]) & used
    return parts[parts.any(axis=1)]

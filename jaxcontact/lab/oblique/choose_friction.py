"""The choice among friction laws by measured oblique impacts, and the next angle to measure."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Unpack

import equinox as eqx
import jax
import numpy as np
from jaxtyping import ArrayLike, Bool

from ... import (
    AbstractFriction,
    AbstractLaw,
    Contact,
    Fit,
    MawBarberFawcett,
    RigidCoulomb,
    RoundBodies,
    WaltonFriction,
)
from ...extend import (
    Candidate,
    Comparison,
    SearchKeywords,
    compared,
    counted,
    refusal,
    stages_of,
    takes,
)
from ..choice.law_choice import chosen_fit
from .fit_oblique import columns_of, fitted
from .measurements import Measurements, ObliqueModel, measurements

_MU, _BETA0, _RATIO = 0.2, 0.3, 0.8
"""Starts; a grid follows."""


def said(fit: Fit) -> str:
    """Return the fitted numbers of a friction law with their standard errors, in words."""
    texts = []
    for name, value in zip(fit.names, fit.values, strict=True):
        error = fit.standard_errors[name]
        if name in fit.at_bound:
            texts.append(f"{name} = {value:.3g} (at its bound)")
        elif error > 0:
            texts.append(f"{name} = {value:.4g} ± {error:.2g}")
        else:
            texts.append(f"{name} = {value:.4g} (not identifiable)")
    return ", ".join(texts)


@dataclasses.dataclass(frozen=True, repr=False)
class FrictionChoice:
    """Friction laws fitted to the same oblique impacts: how well each describes them.

    - `candidates`: the comparison in the order of AICc (see `compare_fits`).
    - `best`: the name of the law to use, None if no fit converged; `verdict`: the same in words.
    - `rivals`: the laws that describe the data as well.
    - `fits`: by name, each a `Fit` whose params are the friction law.
    - `next_measurement`: the measurement that would distinguish best and rivals, in words.
    - `left_out`: the laws that do not apply to this contact, and why.
    """

    candidates: tuple[Candidate, ...]
    best: str | None
    verdict: str
    rivals: tuple[str, ...]
    fits: Mapping[str, Fit]
    next_measurement: str
    left_out: Mapping[str, str]

    def friction(self, name: str | None = None) -> AbstractFriction:
        """Return a fitted friction law, by default the best one.

        Raises ValueError for an unknown name, and if its fit did not converge.
        """
        return chosen_fit("name", name, self.best, self.fits)[1].params

    def table(self) -> str:
        """Return the laws with their parameters and criteria; lower is better."""
        same = Comparison(self.candidates, self.best, self.verdict)
        return same.table(lambda name: said(self.fits[name]))

    @property
    def headline(self) -> str:
        """The best law and its numbers; beside them the range of μ by laws of equal merit."""
        if self.best is None:
            return "No fit converged."
        line = f"{said(self.fits[self.best])} by {self.best}"
        mu = [float(self.friction(name).mu) for name in (self.best, *self.rivals)]
        if self.rivals:
            line += f"; mu = {min(mu):.4g} to {max(mu):.4g} by laws that describe the data as well"
        return line

    def __repr__(self) -> str:
        lines = [self.headline, self.verdict, self.table()]
        if self.best is not None:
            lines += self.fits[self.best].notes
        lines += [f"{name} is left out: {why}" for name, why in self.left_out.items()]
        if self.next_measurement:
            lines.append(self.next_measurement)
        return "\n".join(lines)


def candidates_of(
    given: Any, there: Measurements
) -> tuple[dict[str, AbstractFriction], dict[str, str]]:
    """Return the friction laws to compare by name, and those that do not apply, with the reason.

    Raises ValueError for `given` laws that are no such dict.
    """
    if given is not None:
        return _by_name(given), {}
    ratio = _RATIO if there.model.contact.tangential_ratio is None else None
    laws: dict[str, AbstractFriction] = {
        "rigid Coulomb": RigidCoulomb(_MU),
        "Walton": WaltonFriction(_MU, _BETA0),
        "Maw-Barber-Fawcett": MawBarberFawcett(_MU, ratio),
    }
    left_out = {name: why for name, law in laws.items() if (why := _refusal(law, there))}
    return {name: law for name, law in laws.items() if name not in left_out}, left_out


def _by_name(given: Any) -> dict[str, AbstractFriction]:
    kinds = {str: given, AbstractFriction: given.values()} if isinstance(given, Mapping) else {}
    good = all(isinstance(one, kind) for kind, several in kinds.items() for one in several)
    if not kinds or not good or len(given) < 2:
        raise refusal("friction", "be None or a dict of at least two friction laws by name", given)
    return dict(given)


def _refusal(law: AbstractFriction, there: Measurements) -> str:
    """Return why a friction law has no formula for this contact; "" if it has one."""
    kinds = {name: jax.ShapeDtypeStruct(np.shape(x), float) for name, x in there.x.items()}
    try:
        with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
            jax.eval_shape(lambda x: there.model.formula(law, x), kinds)
    except ValueError as error:
        return str(error)
    return ""


_DEGREES = np.arange(1.0, 86.0)

_ALIKE = 2e-3
"""Difference of v_t'/v_t that no measurement resolves."""

_curve = eqx.filter_jit(ObliqueModel.__call__)


def next_angle(best: Fit, rivals: Sequence[Fit], there: Measurements) -> str:
    """Return where to measure next, in words; "" without rivals."""
    if not rivals:
        return ""
    speed = float(np.median(np.hypot(*there.x.values())))
    angle = np.radians(_DEGREES)
    x = {"velocity": speed * np.cos(angle), "tangential_velocity": speed * np.sin(angle)}
    model = dataclasses.replace(there.model, fields=("tangential_restitution",))
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        curves = [
            np.asarray(_curve(model, fit.params, jax.device_put(x))["tangential_restitution"])
            for fit in (best, *rivals)
        ]
    apart = np.min([np.abs(curve - curves[0]) for curve in curves[1:]], axis=0)
    i = int(np.nanargmax(apart))
    if not apart[i] > _ALIKE:
        return "These laws differ at no angle by more than a measurement resolves."
    return (
        f"They differ most at an angle of impact of {_DEGREES[i]:.0f} degrees from the normal, by "
        f"{apart[i]:.2g} in v_t'/v_t: measure there."
    )


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
    tell, options = stages_of(progress), {**how, "throw": False}
    reweighs = options.get("noise") is None
    options["noise"] = "common" if reweighs else options["noise"]
    fits = {}
    for name, one in laws.items():
        tell(f"fitting {name}")
        fits[name] = fitted(one, there, options)
    if reweighs and there.unlike:
        for _ in range(_ROUNDS):
            best = min(fits.values(), key=lambda fit: (not fit.converged, fit.loss))
            there = there.reweighed(best.residuals)
            fits = {name: fitted(one, there, options) for name, one in laws.items()}
    comparison = compared(
        fits,
        _parts(there),
        parameters=lambda name: said(fits[name]),
        left_out="impacts",
        group="impact",
    )
    equal = comparison.undecided(next(iter(fits.values())))
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


def _parts(there: Measurements) -> Bool[np.ndarray, "folds n"]:
    """Return which points each fold leaves out: every fourth impact in the order of its angle."""
    slope = there.x["tangential_velocity"] / there.x["velocity"]
    rank = np.argsort(np.argsort(slope, kind="stable"))
    used = np.concatenate([there.factor[name] > 0 for name in sorted(there.factor)])
    fold = np.tile(rank % _FOLDS, len(there.factor))
    parts = (fold == np.arange(_FOLDS)[:, None]) & used
    return parts[parts.any(axis=1)]

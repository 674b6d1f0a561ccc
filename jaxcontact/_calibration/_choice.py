"""Which law describes a table of restitutions over the closing speed."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._contact import Contact
from .._fit import Between, Fit, Positive, compare_fits, fit
from .._fit._compare import Candidate
from .._parameter import POSITIVE, RESTITUTION
from ._asked import Asked, asked_of
from ._checks import column
from ._curves import Curve
from ._damping import fit_damping
from ._viscous import viscous_restitution

CONSTANT = "constant e"
_BANDS = 5
_WIDTH = 21


class ConstantRestitution(eqx.Module):
    """e at every speed."""

    def __call__(self, params: dict[str, Array], velocity: Float[Array, " n"]) -> Array:
        return jnp.broadcast_to(params["e"], velocity.shape)


class DeliveredByViscosity(eqx.Module):
    """e(v) of Kuwabara and Kono's law with A in s, n = 3/2."""

    contact: Contact

    def __call__(self, params: dict[str, Array], velocity: Float[Array, " n"]) -> Array:
        frequency = (self.contact.stiffness / self.contact.mass) ** 0.4
        return viscous_restitution(params["A"] * frequency * velocity**0.2)


@dataclasses.dataclass(frozen=True)
class LawChoice:
    """All laws on one table of e(v): how well each kind of law does, and with which parameters.

    `fits` by kind; `candidates`, in the order of AICc, are how the kinds compare; `asked` says what
    each law of constant e is to be asked for; `best` is the kind to use, None where no fit
    converged; `verdict` says it in words.
    """

    fits: Mapping[str, Fit]
    candidates: tuple[Candidate, ...]
    asked: tuple[Asked, ...]
    best: str | None
    verdict: str

    def __repr__(self) -> str:
        aicc = min(c.aicc for c in self.candidates)
        bic = min(c.bic for c in self.candidates)
        lines = [f"{'':{_WIDTH}}  k        loss    ΔAICc     ΔBIC  held out  parameters"]
        for c in self.candidates:
            found = self.fits[c.name]
            note = "" if c.converged else "  not converged"
            lines.append(
                f"{c.name:{_WIDTH}} {c.k:2d}  {c.loss:10.5g} {c.aicc - aicc:8.2f} "
                f"{c.bic - bic:8.2f} {c.held_out:9.4g}  {_parameters(found)}{note}"
            )
        lines.append(self.verdict)
        if self.best == CONSTANT:
            lines.append("Ask for it, in e,")
            lines += [f"  {a.sentence}" for a in self.asked]
        return "\n".join(lines)


def choose_law(
    velocity: ArrayLike,
    e: ArrayLike,
    contact: Contact,
    *,
    groups: ArrayLike | None = None,
    **how: Any,
) -> LawChoice:
    """Every law on a table of restitutions over the closing speed, and which of them to use.

    Laws fall into kinds by e(v): a constant e, which most of them deliver (each asked for a number
    of its own); a constant c, with α = c v/K (also Marhefka and Orin's law, with a = c/K); c that
    goes as a power of v; and, for n = 3/2, Kuwabara and Kono's. One fit for each kind.

    Arguments: closing speeds `velocity` in m/s and restitutions `e` in (0, 1], both (points,); the
    `contact`, whose mass and stiffness are taken as known (e(v) knows only c/K and A (K/m)^(2/5));
    `groups` (points,) that are left out together to find the held-out error, by default five bands
    of speed; what else `fit` takes (`sigma`, `weights`, ...), for all of them.

    Returns a `LawChoice`, which prints as a table with a verdict, and which `jc.plot.choice` draws.
    Raises ValueError for columns that do not match or leave their range, and what `fit` and
    `compare_fits` raise. Source: Burnham & Anderson (2002), doi 10.1007/b97636.
    """
    v = column(velocity, "velocity", POSITIVE)
    measured = column(e, "e", RESTITUTION, len(v))
    typical = min(max(float(np.median(measured)), 0.01), 0.999)
    fits = {
        CONSTANT: fit(
            ConstantRestitution(), measured, {"e": typical}, x=v, transforms=Between(0, 1), **how
        ),
        "constant c": fit_damping(v, measured, contact, **how),
        "c as a power of v": fit_damping(v, measured, contact, form="power", **how),
    }
    if isinstance(contact.exponent, float) and contact.exponent == 1.5:
        fits["Kuwabara-Kono"] = _viscous(v, measured, typical, contact, how)
    if groups is None:
        bands = min(_BANDS, len(v))
        groups = np.argsort(np.argsort(v, kind="stable"), kind="stable") * bands // len(v)
    folds = min(_BANDS, len(np.unique(np.asarray(groups))))
    candidates = compare_fits(fits, folds=folds, groups=groups).candidates
    constant = fits[CONSTANT]
    error = float(constant.standard_errors["e"])
    asked = asked_of(float(constant.params["e"]), None if math.isnan(error) else error)
    return LawChoice(fits, candidates, asked, *_verdict(fits, candidates))


def _viscous(
    v: np.ndarray, measured: np.ndarray, typical: float, contact: Contact, how: dict[str, Any]
) -> Fit:
    curve = Curve("kuwabara_kono", "kuwabara_kono")
    strength = float(curve.value(curve.start(typical, float(np.exp(np.mean(np.log(v)))))))
    frequency = (np.asarray(contact.stiffness, float) / np.asarray(contact.mass, float)) ** 0.4
    start = {"A": strength / frequency}
    model = DeliveredByViscosity(contact)
    return fit(model, measured, start, x=v, transforms=Positive(), **how)


def _verdict(fits: Mapping[str, Fit], candidates: tuple[Candidate, ...]) -> tuple[str | None, str]:
    """Which kind of law to use, and why, in a few sentences."""
    good = [c for c in candidates if c.converged]
    if not good:
        return None, "No fit converged."
    best = good[0]
    # Of equally good ones the simplest: the one with the fewest numbers, a constant e first.
    equal = [c for c in good if c.aicc - best.aicc < 2]
    simple = min(equal, key=lambda c: (c.k, c.name != CONSTANT))
    how = "best" if len(equal) == 1 else "as well as any"
    text = f"Use {simple.name}, which describes the data {how}: {_parameters(fits[simple.name])}."
    others = [c.name for c in equal if c is not simple]
    if others:
        text += f" The data do not tell it from {' or '.join(others)}."
    worse = [c for c in good if c not in equal]
    if worse:
        text += f" Next, {worse[0].name} is worse by {worse[0].aicc - best.aicc:.1f} in AICc."
    brief = min(good, key=lambda c: c.bic)
    if brief.name != simple.name:
        gain = next(c.bic for c in good if c.name == simple.name) - brief.bic
        text += f" BIC, which asks more of each number, prefers {brief.name} by {gain:.1f}."
    judged = [c for c in good if not math.isnan(c.held_out)]
    held = min(judged, key=lambda c: c.held_out, default=simple)
    if held not in equal:
        text += f" But speeds that were left out are predicted best by {held.name}."
    return simple.name, text


def _parameters(found: Fit) -> str:
    said = []
    for name, error in found.standard_errors.items():
        value = float(found.params[name])
        told = "" if math.isnan(float(error)) else f" ± {float(error):.2g}"
        said.append(f"{name} = {value:.5g}{told}")
    return ", ".join(said)

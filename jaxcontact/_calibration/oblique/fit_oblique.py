"""The numbers of a friction law from measured oblique impacts, and their regimes."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple, Unpack

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from ..._contact import Contact
from ..._fit import Fit, Fixed, fit
from ..._fit.keywords import ColumnKeywords, takes
from ..._friction import AbstractFriction
from ..._friction.base import require_friction
from ..._impact import RoundBodies
from ..._laws import AbstractLaw
from ..._text.words import counted
from ..pairs.columns import with_transforms
from .jump import at_jump
from .measurements import Measurements, measurements
from .model import ObliqueModel
from .start import lowest

_IMPACTS = "impact", "impacts"
_ROUNDING = 1e-9
_AT_JUMP = 1e-6


class Regimes(NamedTuple):
    """How many of the impacts that were measured slid throughout, by a friction law.

    `margin` is the least distance of an impact to a jump of its outcome or slope, None for laws
    without jumps.
    """

    slid: int
    count: int
    margin: float | None

    @property
    def has_jumps(self) -> bool:
        """True if the slope of an outcome may jump."""
        return self.margin is not None

    @property
    def at_jump(self) -> bool:
        """True if an impact is at a jump."""
        return self.margin is not None and self.margin < _AT_JUMP

    @property
    def note(self) -> str:
        """What the impacts determine, in words."""
        which = f"{self.slid} of {counted(self.count, _IMPACTS)} slid throughout"
        if self.slid == self.count:
            return f"{which}: only μ follows from them; measure closer to the normal as well"
        if self.slid == 0:
            return f"{which}: μ follows from the tangential spring alone; measure nearer grazing"
        return which


_rebound = eqx.filter_jit(ObliqueModel.rebound)


def regimes_of(friction: AbstractFriction, there: Measurements) -> Regimes:
    """Return the regimes of the measured impacts by a friction law."""
    used = np.any([factor > 0 for factor in there.factor.values()], axis=0)
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        after = _rebound(there.model, friction, {n: jnp.asarray(x) for n, x in there.x.items()})
    # A ramp slides at any speed; in full sliding the impulse has the ratio μ.
    slid = np.asarray(after.impulse_ratio) > np.asarray(friction.mu) * (1 - _ROUNDING)
    margin = None if after.margin is None else float(np.min(np.asarray(after.margin)[used]))
    return Regimes(int(np.sum(slid & used)), int(used.sum()), margin)


@takes(ColumnKeywords, noise=None)
def fit_oblique(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    tangential_velocity: ArrayLike,
    *,
    friction: AbstractFriction,
    tangential_restitution: ArrayLike | None = None,
    rebound_angle: ArrayLike | None = None,
    rebound_spin: ArrayLike | None = None,
    sigma_tangential_restitution: ArrayLike | None = None,
    sigma_rebound_angle: ArrayLike | None = None,
    sigma_rebound_spin: ArrayLike | None = None,
    bodies: RoundBodies | str | None = None,
    **how: Unpack[ColumnKeywords],
) -> Fit:
    """Fit a friction law to the rebounds of oblique impacts: μ, and κ, β0 or v_d if it has them.

    Arguments: the `law` and the `contact` of the normal motion, which are known. The closing speeds
    `velocity` v_n = v cos θ > 0 and `tangential_velocity` v_t = v sin θ ≥ 0 in m/s, with θ from the
    normal; no spin before. `friction`, as in `oblique_impact`, is the start: all its numbers are
    fitted. A `ratio` of None stays that of the contact's materials, and
    `transforms={"ratio": jc.Fixed()}` holds a given one.

    Measured, at least one of them, NaN for missing readings, all (points,):
    `tangential_restitution` v_t'/v_t; `rebound_angle` arctan(v_t'/v_n') in rad, from the normal,
    negative if v_t reversed; `rebound_spin` in rad/s, of the first body, positive in the sense of
    rolling (`-hit.spin[0]` of an `oblique_impact`). A spin needs `bodies` with radii; otherwise
    `bodies` is the name of a shape, by default "sphere".

    `sigma_...`: the standard deviation of each column (one number, or one for each point), of all
    or of none. Without them the fit estimates the noise of each column (`noise` is "by column" by
    default). The search starts from the lowest loss on a grid of numbers that holds the given
    start. Other keywords go to `fit`.

    Returns a `Fit` whose params are the fitted friction law; its notes count the impacts that slid
    throughout. They determine nothing but μ, and those of laws without a tangential spring alone
    determine it. The slope of such a law jumps between sticking and sliding; a note says if the
    lowest loss is at a jump. Raises ValueError for columns that do not match or are out of range,
    and as `oblique_impact` does.

    Source: Maw, Barber & Fawcett (1976), doi 10.1016/0043-1648(76)90201-5; Foerster et al. (1994),
    doi 10.1063/1.868282.
    """
    columns = columns_of(
        (tangential_restitution, sigma_tangential_restitution),
        (rebound_angle, sigma_rebound_angle),
        (rebound_spin, sigma_rebound_spin),
    )
    require_friction(friction)
    there = measurements(law, contact, velocity, tangential_velocity, bodies, columns)
    return fitted(friction, there, dict(how))


def columns_of(*columns: tuple[Any, Any]) -> dict[str, tuple[Any, Any]]:
    """Return values and standard deviations of the measured columns by name."""
    names = "tangential_restitution", "rebound_angle", "rebound_spin"
    return dict(zip(names, columns, strict=True))


def fitted(friction: AbstractFriction, there: Measurements, how: dict[str, Any]) -> Fit:
    """Return the fit of a friction law to measurements, with notes on what they determine."""
    how = with_transforms({}, how)
    if how.get("noise") is None:
        several = len(there.table["data"]) > 1 and "sigma" not in there.table
        how["noise"] = "by column" if several else "common"
    held = {name for name, one in how["transforms"].items() if isinstance(one, Fixed)}
    start = lowest(friction, there, frozenset(held))
    found = fit(there.model, start=start, x=there.x, **(there.table | how))
    if not np.isfinite(found.values).all():
        return found
    if not found.converged and not found.at_bound and regimes_of(found.params, there).has_jumps:
        tried = at_jump(found)
        found = tried if regimes_of(tried.params, there).at_jump else found
    return dataclasses.replace(found, notes=(*found.notes, regimes_of(found.params, there).note))

"""The numbers of a friction law from measured oblique impacts."""

from __future__ import annotations

import dataclasses
from typing import Any, Unpack

import numpy as np
from jaxtyping import ArrayLike

from ..._contact import Contact
from ..._fit import Fit, Fixed, fit
from ..._fit.keywords import ColumnKeywords, takes
from ..._friction import AbstractFriction
from ..._friction.base import require_friction
from ..._impact import RoundBodies
from ..._laws import AbstractLaw
from ..pairs.columns import with_transforms
from .jump import at_jump
from .measurements import Measurements, measurements
from .regimes import regimes_of
from .start import lowest


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

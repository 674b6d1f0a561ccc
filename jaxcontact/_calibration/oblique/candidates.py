"""The friction laws that are compared."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from ..._entry import rendered
from ..._friction import (
    AbstractFriction,
    MawBarberFawcett,
    RigidCoulomb,
    WaltonFriction,
)
from .measurements import Measurements

_MU, _BETA0, _RATIO = 0.2, 0.3, 0.8
"""Starts; a grid follows."""


def candidates_of(
    given: Any, there: Measurements
) -> tuple[dict[str, AbstractFriction], dict[str, str]]:
    """Return the friction laws to compare by name, and those that do not apply, with the reason.

    Without `given` ones these are rigid Coulomb, Walton and Maw-Barber-Fawcett. The last has the
    ratio of the contact, which is fitted if it is unknown.
    """
    if given is not None:
        return _given(given), {}
    ratio = _RATIO if there.model.contact.tangential_ratio is None else None
    laws: dict[str, AbstractFriction] = {
        "rigid Coulomb": RigidCoulomb(_MU),
        "Walton": WaltonFriction(_MU, _BETA0),
        "Maw-Barber-Fawcett": MawBarberFawcett(_MU, ratio),
    }
    left_out = {name: why for name, law in laws.items() if (why := _refusal(law, there))}
    return {name: law for name, law in laws.items() if name not in left_out}, left_out


def _refusal(law: AbstractFriction, there: Measurements) -> str:
    """Return why a friction law has no formula for this contact; "" if it has one."""
    kinds = {name: jax.ShapeDtypeStruct(np.shape(x), float) for name, x in there.x.items()}
    try:
        with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
            jax.eval_shape(lambda x: there.model.formula(law, x), kinds)
    except ValueError as error:
        return str(error)
    return ""


def _given(laws: Any) -> dict[str, AbstractFriction]:
    """Return friction laws given by name; raise ValueError for anything else."""
    good = isinstance(laws, Mapping) and len(laws) > 1
    good = good and all(isinstance(one, AbstractFriction) for one in laws.values())
    if not good or not all(isinstance(name, str) for name in laws):
        raise ValueError(
            "Argument `friction` must be None or a dict of at least two friction laws by name, but "
            f"is {rendered(laws)}."
        )
    return dict(laws)

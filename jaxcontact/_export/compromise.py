"""One set of parameters for several speeds."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.optimize import root_scalar

from .._impact import impact
from .wanted import Draft, Wanted

_HALVINGS = 40
_XTOL = 1e-11


def compromise(
    draft: Callable[[Wanted], Draft],
    wanted: Wanted,
    speeds: Float[np.ndarray, " n"],
    targets: Float[np.ndarray, " n"],
) -> Draft:
    """Return the draft with the smallest maximum error of e over the speeds.

    An engine's parameters form one family, indexed by the e delivered at `wanted.velocity`. e at
    every other speed rises with it. At the optimum the largest errors above and below the targets
    are equal: max(e - e*) + min(e - e*) = 0, which has one root.
    """

    def excess(e: float) -> float:
        made = draft(dataclasses.replace(wanted, restitution=e))
        errors = np.asarray(impact(made.law, made.contact, speeds).restitution) - targets
        return float(errors.max() + errors.min())

    low, high = float(targets.min()), float(targets.max())
    for _ in range(_HALVINGS):
        if not excess(low) > 0:
            break
        low /= 2
    for _ in range(_HALVINGS):
        if not excess(high) < 0:
            break
        # If e falls faster with speed than the targets, the best law is elastic at low speeds.
        high = 1 - (1 - high) / 2
    best = low if low >= high else root_scalar(excess, bracket=(low, high), xtol=_XTOL).root
    return draft(dataclasses.replace(wanted, restitution=best))

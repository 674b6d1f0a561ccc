"""One set of parameters for several speeds."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.optimize import root_scalar

from .._impact import impact
from ._wanted import Draft, Wanted

_HALVINGS = 40
_XTOL = 1e-11


def compromise(
    draft: Callable[[Wanted], Draft],
    wanted: Wanted,
    speeds: Float[np.ndarray, " n"],
    targets: Float[np.ndarray, " n"],
) -> Draft:
    """The draft whose largest error of e over the speeds is least.

    An engine's parameters are one family, by the e that they deliver at `wanted.velocity`, and its
    e rises with that at every speed. So the best is where the largest error above the targets is as
    large as that below: max(e - e*) + min(e - e*) = 0, which has one root.
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
        # A law that falls faster with speed than the targets is best elastic at the slow ones.
        high = 1 - (1 - high) / 2
    best = low if low >= high else root_scalar(excess, bracket=(low, high), xtol=_XTOL).root
    return draft(dataclasses.replace(wanted, restitution=best))

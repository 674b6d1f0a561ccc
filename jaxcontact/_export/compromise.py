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
_SAME = 1e-9
"""Largest error of e of a law that is the wanted one, solved by the same formula."""


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

    def errors_of(made: Draft) -> Float[np.ndarray, " n"]:
        return np.asarray(impact(made.law, made.contact, speeds).restitution) - targets

    def excess(e: float) -> float:
        errors = errors_of(draft(dataclasses.replace(wanted, restitution=e)))
        return float(errors.max() + errors.min())

    # An engine with the same law has no family: its parameters do not depend on the e.
    if np.abs(errors_of(made := draft(wanted))).max() <= _SAME:
        return made
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

"""The choice between records with and without a low-pass filter of the instrument."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..._fit import Fit
from ..._fit.compare import criteria

_EXCLUDED = 3.84
"""Increase of the deviance at which a cut-off is excluded: χ² of one parameter at 95 %."""

_OCTAVE, _PARTS = 2.0, 4
"""Factor between cut-offs that are tried, from the highest, and steps within the last one."""

_LEAST_TURNS = 0.1
"""Lowest cut-off that is tried, times the length of the record."""


def criterion(found: Fit) -> float:
    """Return the AICc of a fit, with the determinant of the correlation of its noise."""
    whitener = found.problem.whitener
    volume = 0.0 if whitener is None else -2 * float(np.sum(np.log(np.diag(whitener))))
    return criteria(found)[1] + volume


def without_a_needless_filter(
    found: Fit,
    column: str,
    time: np.ndarray,
    search: Callable[[Any], Fit],
    held: Callable[[Any], Fit],
) -> Fit:
    """Return the fit, or the one without the filter of a column if that has the lower AICc.

    The note then states the lowest cut-off f_c that the record allows (95 %, by the likelihood with
    all other numbers fitted again), and the largest delay. `search` fits from given parameters, and
    `held` fits with the cut-offs of filters held and independent noise.
    """
    name = f"low_pass_{column}"
    plain = search(dataclasses.replace(found.params, **{name: None}))
    if not plain.converged or (found.converged and criterion(found) < criterion(plain)):
        return found
    low_pass, most = getattr(found.params, name), criterion(plain) + _EXCLUDED
    delay, last = low_pass.delay * low_pass.cutoff, plain.params
    lowest = (time.size - 1) / float(time[-1] - time[0]) / 2
    end = _LEAST_TURNS / float(time[-1] - time[0])
    for factor in (_OCTAVE, _OCTAVE ** (1 / _PARTS)):
        while lowest > end:
            cutoff = lowest / factor
            filtered = eqx.tree_at(lambda f: f.cutoff, low_pass, jnp.asarray(cutoff))
            # The filter delays: the touch is earlier by as much.
            touch = plain.params.start_time - delay / cutoff
            tried = held(dataclasses.replace(last, start_time=touch, **{name: filtered}))
            if not criterion(tried) < most:
                break
            lowest, last = cutoff, tried.params
    note = (
        f"a low-pass filter of {column} does not lower AICc and is left out: its cut-off is at "
        f"least {lowest:.3g} Hz, its delay at most {float(delay) / lowest:.2g} s (95 %)"
    )
    return dataclasses.replace(plain, notes=(*plain.notes, note))

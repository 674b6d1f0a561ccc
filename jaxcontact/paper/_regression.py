"""β of Eq. 22 by regression, for every choice that the paper leaves open."""

from __future__ import annotations

import itertools

import numpy as np

from .._calibration import VelocityProfile, fit_velocity_profile
from ._compression import SAMPLINGS, Compression, Sampling
from ._impacts import CASES
from ._reproduction import Table, long_table

INTERVALS = 1000
"""Intervals between the samples of a regression."""

FEWER = (20, 50, 200, 1000)
"""Numbers of intervals that divide `INTERVALS`."""

DEFAULT: tuple[Sampling, bool] = ("indentation", False)
"""Samples uniform in δ, the residual in δ': a fit of the curve in Fig. 4."""

_RESIDUALS = {False: "velocity", True: "velocity squared"}


def regress(
    curve: Compression,
    sampling: Sampling = DEFAULT[0],
    squared: bool = DEFAULT[1],
    intervals: int = INTERVALS,
) -> VelocityProfile:
    """Return the profile closest to a compression; see `fit_velocity_profile`."""
    depth = curve.positions(sampling, INTERVALS)
    # Weights select fewer samples, so that only one length is compiled.
    chosen = np.arange(INTERVALS + 1) % (INTERVALS // intervals) == 0
    return fit_velocity_profile(depth, curve.velocity_at(depth), weights=chosen, squared=squared)


def regression_tables(curves: list[Compression]) -> dict[str, Table]:
    """Return the tables "regression", "band" and "samples" of Fig. 4, for both cases."""
    number = np.arange(1, len(CASES) + 1)
    choices = list(itertools.product(SAMPLINGS, _RESIDUALS))
    fits = [[regress(curve, *choice) for choice in choices] for curve in curves]
    beta = np.array([[fit.beta for fit in row] for row in fits])
    residual = np.array([[fit.residual for fit in row] for row in fits])
    published = np.array([case.beta for case in CASES])
    default = beta[:, choices.index(DEFAULT)]
    low, high = beta.min(axis=1), beta.max(axis=1)
    fewer = np.array([[regress(curve, intervals=n).beta for n in FEWER] for curve in curves])
    regression = {
        "case": number[:, None],
        "uniform_in": [sampling for sampling, _ in choices],
        "residual_in": [_RESIDUALS[squared] for _, squared in choices],
        "beta": beta,
        "published_beta": published[:, None],
        "difference": beta - published[:, None],
        "rms_residual": residual,
    }
    return {
        "regression": long_table(regression),
        "band": {
            "case": number,
            "published_beta": published,
            "beta": default,
            "difference": default - published,
            "lowest_beta": low,
            "highest_beta": high,
            "published_inside": (low <= published) & (published <= high),
        },
        "samples": long_table({"case": number[:, None], "intervals": FEWER, "beta": fewer}),
    }

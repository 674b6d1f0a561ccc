"""Impacts that add energy, looked for by Python after a run."""

from __future__ import annotations

import numpy as np

from ..._program import traced
from ..result import Impacts
from ..run_record import RunRecord

_SURE = 10
"""Errors of an impact beyond which it has gained energy."""


def some_impact_gains(record: RunRecord, impacts: Impacts) -> bool:
    """Return whether a whole impact has a negative loss, beyond its error; False if traced.

    Parts of impacts are left out: they may return energy that was stored before the run.
    """
    if traced((record, impacts)):
        return False
    # In NumPy, which needs no compilation.
    inverse = np.zeros(len(impacts.names))
    inverse[np.asarray(record.layout.body)] = np.asarray(record.numbers.inverse_mass)
    columns = impacts.to_dict()
    whole = np.isfinite(columns["restitution"]) & (columns["time"] >= 0)
    share = inverse[columns["first"]] + inverse[columns["second"]]
    error = np.maximum(columns["error_estimate"], float(record.tolerance))
    gain = -2 * columns["energy_loss"] * share
    return bool(np.any(whole & (gain > _SURE * error * columns["closing_speed"] ** 2)))

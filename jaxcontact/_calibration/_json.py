"""A calibration as plain numbers, for JSON."""

from __future__ import annotations

import importlib.metadata
import math
from typing import Any

import numpy as np

from .._measurements._outliers import THRESHOLD
from ._calibrate import Calibration, FitSet, LawFit
from ._report import drag_caution, drag_sentence, errors_sentence, line_sentence

_PACKAGES = ("jaxcontact", "jax", "optax", "numpy")


def to_dict(calibration: Calibration, options: dict[str, Any] | None = None) -> dict[str, Any]:
    """Everything in the calibration as a dictionary of plain numbers, strings and lists.

    Units are in the names (`_m_s`, `_s`, `_m`) or beside the value; what is not determined is None.
    `options` are recorded as given.
    """
    c = calibration
    drag = c.pairs.flight.drag
    reading = c.pairs.layout.reading_error
    unit = None if reading is None else reading.unit
    return {
        "versions": {name: _version(name) for name in _PACKAGES},
        "options": options or {},
        "recording": {
            "file": c.pairs.source,
            "layout": c.pairs.layout.name,
            "ball": c.pairs.ball or None,
            "pairs": len(c.pairs),
            "unpaired_intervals": c.pairs.unpaired,
            "trials": [c.pairs.cluster_names[k] for k in np.unique(c.pairs.cluster)],
        },
        "flight": {
            "gravity_m_s2": c.pairs.flight.gravity,
            "drag": None
            if drag is None
            else {
                "mass_kg": drag.mass,
                "radius_m": drag.radius,
                "coefficient": drag.coefficient,
                "air_density_kg_m3": drag.air_density,
                "terminal_speed_m_s": c.pairs.flight.terminal_speed,
            },
            "note": "drag " + drag_sentence(c),
        },
        "noise": {
            "relative": c.noise.relative,
            "reading": None if unit is None else c.noise.reading,
            "reading_unit": unit,
        },
        "outlier_rule": {
            "threshold_robust_standard_deviations": THRESHOLD,
            "trend": c.outliers.trend.kind,
            "marked": int(c.outliers.flagged.sum()),
        },
        "pairs": [
            {
                "rows": sorted({int(c.pairs.first_row[k]), int(c.pairs.second_row[k])}),
                "velocity_m_s": float(c.pairs.velocity[k]),
                "restitution": float(c.pairs.restitution[k]),
                "deviation": float(c.outliers.deviation[k]),
                "marked": bool(c.outliers.flagged[k]),
                "may_be": c.outliers.guess.get(k),
            }
            for k in range(len(c.pairs))
        ],
        "standard_errors": errors_sentence(c),
        "caution": drag_caution(c),
        "constant_e_laws": [
            {
                "law": a.law,
                "e": a.e,
                "standard_error": _finite(a.standard_error),
                "delivers_at_least": a.least,
                "delivers_at_most": a.most,
            }
            for a in c.asked
        ],
        "without_marked": _set_dict(c.kept),
        "with_marked": _set_dict(c.everything),
        "converged": c.converged,
    }


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None  # run from a source tree that was never installed


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else value


def _set_dict(fits: FitSet) -> dict[str, Any]:
    return {
        "pairs": fits.count,
        "fits": [_fit_dict(fit) for fit in fits.fits],
        "line": {
            "slope_s_m": fits.line.slope,
            "slope_standard_error_s_m": _finite(fits.line.slope_error),
            "level": fits.line.level,
            "aicc": _finite(fits.line.aicc),
            "reduced_chi2": fits.line.reduced_chi2,
            "note": line_sentence(fits),
        },
        "comparisons": [
            {
                "constant": c.constant,
                "other": c.other,
                "aicc_difference": c.difference,
                "by_trial_standard_errors": _finite(c.by_trial),
                "verdict": c.verdict,
            }
            for c in fits.comparisons
        ],
    }


def _fit_dict(fit: LawFit) -> dict[str, Any]:
    return {
        "law": fit.curve.law,
        "kind": fit.curve.kind,
        "estimates": [
            {
                "name": e.name,
                "value": e.value,
                "standard_error": _finite(e.standard_error),
                "unit": e.unit or None,
            }
            for e in fit.estimates
        ],
        "standard_errors": fit.error_kind,
        "determined": fit.determined,
        "not_identified": fit.curve.unidentified,
        "rms_of_e": fit.rms,
        "reduced_chi2": fit.reduced_chi2,
        "aicc": fit.aicc,
        "bic": fit.bic,
        "held_out_rms": fit.held_out,
        "converged": fit.converged,
        "reason": fit.reason,
        "evaluations": fit.evaluations,
        "gradient_norm": fit.gradient_norm,
    }

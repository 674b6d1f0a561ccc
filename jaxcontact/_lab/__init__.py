"""The laboratory: recordings and instrument records are read, calibrated, reported and drawn.

No lower room imports it: laws, impacts, scenes, fits and calibrations of arrays work without
it. Names are loaded on first use.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

if _TYPE_CHECKING:
    from .calibration.calibrate import Calibration as Calibration
    from .calibration.calibrate import calibrate as calibrate
    from .calibration.calibrate_friction import FrictionCalibration as FrictionCalibration
    from .calibration.calibrate_friction import calibrate_friction as calibrate_friction
    from .calibration.summary import CalibrationSummary as CalibrationSummary
    from .calibration.summary import load_calibration as load_calibration
    from .recordings import Recording as Recording
    from .recordings import RecordingError as RecordingError
    from .recordings import read_recording as read_recording
    from .records.fit_record import fit_record as fit_record
    from .records.low_pass import LowPass as LowPass
    from .report_page import report as report

_HOME = {
    "Calibration": "calibration.calibrate",
    "CalibrationSummary": "calibration.summary",
    "FrictionCalibration": "calibration.calibrate_friction",
    "LowPass": "records.low_pass",
    "Recording": "recordings",
    "RecordingError": "recordings",
    "calibrate": "calibration.calibrate",
    "calibrate_friction": "calibration.calibrate_friction",
    "fit_record": "records.fit_record",
    "load_calibration": "calibration.summary",
    "read_recording": "recordings",
    "report": "report_page",
}


def __getattr__(name: str) -> _Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(_import_module(f".{_HOME[name]}", __name__), name)

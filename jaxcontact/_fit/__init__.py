"""Laws from measurements: recordings, pairs (speed, e), outliers, fits and their report."""

from ._calibrate import Calibration as Calibration
from ._calibrate import Comparison as Comparison
from ._calibrate import Estimate as Estimate
from ._calibrate import FitSet as FitSet
from ._calibrate import LawFit as LawFit
from ._calibrate import calibrate as calibrate
from ._curves import Curve as Curve
from ._curves import choose_curves as choose_curves
from ._curves import constant_laws as constant_laws
from ._curves import parameters_of as parameters_of
from ._flight import Drag as Drag
from ._flight import Flight as Flight
from ._record import to_dict as to_dict
from ._recording import COLUMNS as COLUMNS
from ._recording import Recording as Recording
from ._recording import RecordingError as RecordingError
from ._recording import parse_recording as parse_recording
from ._recording import read_recording as read_recording
from ._report import report as report
from ._velocity_profile import VelocityProfile as VelocityProfile
from ._velocity_profile import fit_velocity_profile as fit_velocity_profile

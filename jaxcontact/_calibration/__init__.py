"""Laws from measurements: ready-made problems, the choice of a law, calibration and its report."""

from ._bounces import fit_bounces as fit_bounces
from ._calibrate import Calibration as Calibration
from ._calibrate import Comparison as Comparison
from ._calibrate import Estimate as Estimate
from ._calibrate import FitSet as FitSet
from ._calibrate import LawFit as LawFit
from ._calibrate import calibrate as calibrate
from ._choice import LawChoice as LawChoice
from ._choice import choose_law as choose_law
from ._curves import Curve as Curve
from ._curves import choose_curves as choose_curves
from ._damping import fit_damping as fit_damping
from ._energy_loss import fit_energy_loss as fit_energy_loss
from ._impacts import fit_impacts as fit_impacts
from ._json import to_dict as to_dict
from ._learned import learn_law as learn_law
from ._record import fit_record as fit_record
from ._report import report as report
from ._shapes import AbstractShape as AbstractShape
from ._shapes import Network as Network
from ._shapes import Rational as Rational
from ._shapes import Spline as Spline
from ._velocity_profile import VelocityProfile as VelocityProfile
from ._velocity_profile import fit_velocity_profile as fit_velocity_profile

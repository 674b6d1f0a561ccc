"""Laws from measurements: ready-made problems, the choice of a law, calibration and its report."""

from ._bounces import fit_bounces as fit_bounces
from ._calibrate import Calibration as Calibration
from ._calibrate import calibrate as calibrate
from ._choice import LawChoice as LawChoice
from ._choose import choose_law as choose_law
from ._damping import fit_damping as fit_damping
from ._design import Design as Design
from ._design import design as design
from ._energy_loss import fit_energy_loss as fit_energy_loss
from ._file import load_calibration as load_calibration
from ._impacts import fit_impacts as fit_impacts
from ._learned import learn_law as learn_law
from ._low_pass import LowPass as LowPass
from ._record import fit_record as fit_record
from ._shapes import AbstractShape as AbstractShape
from ._shapes import Network as Network
from ._shapes import Rational as Rational
from ._shapes import Spline as Spline
from ._summary import CalibrationSummary as CalibrationSummary
from ._velocity_profile import VelocityProfile as VelocityProfile
from ._velocity_profile import fit_velocity_profile as fit_velocity_profile

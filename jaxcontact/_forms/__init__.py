"""Forms: contact forces in scaled units, and all results that depend on their shape alone."""

from .base import AbstractForm as AbstractForm
from .base import Exponent as Exponent
from .base import Flag as Flag
from .base import Lane as Lane
from .base import Momentum as Momentum
from .base import signed_power as signed_power
from .dashpot import DashpotForm as DashpotForm
from .general import GeneralForm as GeneralForm
from .hunt_crossley import HuntCrossleyForm as HuntCrossleyForm
from .hunt_crossley import SpeedDependentForm as SpeedDependentForm
from .hunt_crossley import exact_damping_factor as exact_damping_factor
from .hunt_crossley import rebound_exponent as rebound_exponent
from .hunt_crossley import restitution_of as restitution_of
from .oscillator import OscillatorForm as OscillatorForm
from .plastic import AbstractPlasticForm as AbstractPlasticForm
from .plastic import BilinearForm as BilinearForm
from .plastic import YieldingForm as YieldingForm
from .scale import Change as Change
from .scale import ContactLike as ContactLike
from .scale import Scale as Scale
from .scale import ScaledImpact as ScaledImpact
from .scale import scale_of as scale_of
from .sensitivity import slopes_along as slopes_along
from .viscoelastic import ViscoelasticForm as ViscoelasticForm
from .viscoelastic import ViscoelasticSpheresForm as ViscoelasticSpheresForm

"""Forms: contact forces in scaled units, and all results that depend on their shape alone."""

from ._base import AbstractForm as AbstractForm
from ._base import Exponent as Exponent
from ._base import Flag as Flag
from ._base import Lane as Lane
from ._base import Momentum as Momentum
from ._base import signed_power as signed_power
from ._dashpot import DashpotForm as DashpotForm
from ._general import GeneralForm as GeneralForm
from ._hunt_crossley import HuntCrossleyForm as HuntCrossleyForm
from ._hunt_crossley import SpeedDependentForm as SpeedDependentForm
from ._hunt_crossley import exact_damping_factor as exact_damping_factor
from ._hunt_crossley import rebound_exponent as rebound_exponent
from ._hunt_crossley import restitution_of as restitution_of
from ._oscillator import OscillatorForm as OscillatorForm
from ._scale import Change as Change
from ._scale import ContactLike as ContactLike
from ._scale import Scale as Scale
from ._scale import ScaledImpact as ScaledImpact
from ._scale import scale_of as scale_of
from ._sensitivity import slopes_along as slopes_along
from ._viscoelastic import ViscoelasticForm as ViscoelasticForm
from ._viscoelastic import ViscoelasticSpheresForm as ViscoelasticSpheresForm

"""Forms: contact forces in scaled units, and all results that depend on their shape alone."""

from .base import AbstractForm as AbstractForm
from .base import Exponent as Exponent
from .base import Flag as Flag
from .base import Lane as Lane
from .base import Momentum as Momentum
from .base import signed_power as signed_power
from .hunt_crossley import HuntCrossleyForm as HuntCrossleyForm
from .hunt_crossley import exact_damping_factor as exact_damping_factor
from .hunt_crossley import rebound_exponent as rebound_exponent
from .hunt_crossley import restitution_of as restitution_of
from .oscillator import OscillatorForm as OscillatorForm
from .quadrature import differentiated_forward as differentiated_forward
from .quadrature import integrate as integrate
from .quadrature import lanewise as lanewise
from .quadrature import slopes_along as slopes_along
from .scale import Scale as Scale
from .scale import ScaledImpact as ScaledImpact
from .scale import scale_of as scale_of

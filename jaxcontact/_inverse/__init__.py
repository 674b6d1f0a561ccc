"""Laws from measured arrays: c, β and the parameters of any law, from e(v) and other results."""

from .impacts import fit_damping as fit_damping
from .impacts import fit_energy_loss as fit_energy_loss
from .impacts import fit_impacts as fit_impacts
from .learned_law import AbstractShape as AbstractShape
from .learned_law import Network as Network
from .learned_law import Rational as Rational
from .learned_law import Spline as Spline
from .learned_law import learn_law as learn_law

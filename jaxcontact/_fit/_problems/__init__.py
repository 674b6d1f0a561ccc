"""Ready-made problems: one call each, all of them solved by `fit`."""

from ._bounces import BounceModel as BounceModel
from ._bounces import fit_bounces as fit_bounces
from ._choice import LawChoice as LawChoice
from ._choice import choose_law as choose_law
from ._damping import fit_damping as fit_damping
from ._energy_loss import fit_energy_loss as fit_energy_loss
from ._impacts import fit_impacts as fit_impacts
from ._learned import learn_law as learn_law
from ._record import RecordModel as RecordModel
from ._record import fit_record as fit_record
from ._shapes import AbstractShape as AbstractShape
from ._shapes import Network as Network
from ._shapes import Rational as Rational
from ._shapes import Spline as Spline

"""Laws from measured arrays: fit problems, the choice of a law, and measurement designs."""

from .choice.choose_law import choose_law as choose_law
from .choice.law_choice import LawChoice as LawChoice
from .design.design import Design as Design
from .design.design import design as design
from .oblique.choose_friction import FrictionChoice as FrictionChoice
from .oblique.choose_friction import choose_friction as choose_friction
from .oblique.fit_oblique import fit_oblique as fit_oblique
from .problems.bounces import fit_bounces as fit_bounces
from .problems.damping import fit_damping as fit_damping
from .problems.damping import fit_energy_loss as fit_energy_loss
from .problems.impacts import fit_impacts as fit_impacts
from .problems.learned_law import AbstractShape as AbstractShape
from .problems.learned_law import Network as Network
from .problems.learned_law import Rational as Rational
from .problems.learned_law import Spline as Spline
from .problems.learned_law import learn_law as learn_law
from .problems.velocity_profile import VelocityProfile as VelocityProfile
from .problems.velocity_profile import fit_velocity_profile as fit_velocity_profile

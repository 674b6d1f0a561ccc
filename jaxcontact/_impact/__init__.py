"""A single impact: solution methods and public functions."""

from .derivatives import common_shape as common_shape
from .front_door import problem_of as problem_of
from .front_door import uniform as uniform
from .impact import Landing as Landing
from .impact import impact as impact
from .impact import landing as landing
from .impact import restitution as restitution
from .impact import restitution_at_any_speed as restitution_at_any_speed
from .impact import restitution_is_constant as restitution_is_constant
from .impact import restitutions as restitutions
from .methods.auto import Exact as Exact
from .methods.auto import method_of as method_of
from .methods.event import Event as Event
from .methods.method import AbstractMethod as AbstractMethod
from .methods.phase import Phase as Phase
from .oblique.bodies import RoundBodies as RoundBodies
from .oblique.oblique_impact import oblique_impact as oblique_impact
from .oblique.oblique_trajectory import ObliqueTrajectory as ObliqueTrajectory
from .oblique.oblique_trajectory import oblique_trajectory as oblique_trajectory
from .oblique.result import ObliqueImpact as ObliqueImpact
from .oblique.result import Slip as Slip
from .result import Impact as Impact
from .result import Status as Status
from .trajectory import Energy as Energy
from .trajectory import Trajectory as Trajectory
from .trajectory import trajectory as trajectory

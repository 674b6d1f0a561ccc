"""One impact: methods that solve it, and the functions that people call."""

from ._event import Event as Event
from ._front_door import problem_of as problem_of
from ._front_door import uniform as uniform
from ._impact import Landing as Landing
from ._impact import impact as impact
from ._impact import landing as landing
from ._impact import restitution as restitution
from ._impact import restitution_at_any_speed as restitution_at_any_speed
from ._impact import restitution_is_constant as restitution_is_constant
from ._impact import restitutions as restitutions
from ._method import AbstractMethod as AbstractMethod
from ._methods import Exact as Exact
from ._methods import method_of as method_of
from ._phase import Phase as Phase
from ._result import Impact as Impact
from ._result import Status as Status
from ._trajectory import Energy as Energy
from ._trajectory import Trajectory as Trajectory
from ._trajectory import trajectory as trajectory

"""One impact: scaling, closed forms, phase angle, event-terminated solve, and the front door."""

from ._form import restitution_is_constant as restitution_is_constant
from ._front_door import problem_of as problem_of
from ._impact import impact as impact
from ._impact import restitution as restitution
from ._result import Impact as Impact
from ._result import Status as Status
from ._trajectory import Energy as Energy
from ._trajectory import Trajectory as Trajectory
from ._trajectory import trajectory as trajectory

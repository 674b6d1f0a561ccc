"""Contact laws inside of MuJoCo MJX."""

from .._inside.time_step import time_step as time_step
from ._contact_force import ContactForce as ContactForce
from ._contact_force import contact_force as contact_force

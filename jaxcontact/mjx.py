"""Contact laws inside of MuJoCo MJX."""

from .engines.inside.time_step import time_step as time_step
from .engines.mjx import ContactForce as ContactForce
from .engines.mjx import contact_force as contact_force

"""Contact laws inside of JaxSim."""

from .._inside.time_step import time_step as time_step
from ._contact_force import TerrainForce as TerrainForce
from ._contact_force import contact_force as contact_force

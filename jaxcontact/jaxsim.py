"""Contact laws inside of JaxSim."""

from .engines.inside.time_step import time_step as time_step
from .engines.jaxsim import TerrainForce as TerrainForce
from .engines.jaxsim import contact_force as contact_force

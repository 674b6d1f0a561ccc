"""Event-driven simulation of scenes with many bodies."""

from .bodies.bodies import Box as Box
from .bodies.bodies import Plane as Plane
from .bodies.bodies import Shell as Shell
from .bodies.bodies import Sphere as Sphere
from .bodies.motion import Prescribed as Prescribed
from .bodies.motion import Steady as Steady
from .bodies.motion import Vibration as Vibration
from .bodies.random_spheres import random_spheres as random_spheres
from .bodies.scene import Scene as Scene
from .file import read_scene as read_scene
from .readout.margin import Margin as Margin
from .result import Ending as Ending
from .result import Impacts as Impacts
from .result import SolvedBy as SolvedBy
from .result import States as States
from .run import EngineRun as EngineRun
from .run import Run as Run

"""Scenes of many bodies: from impact to impact."""

from ._bodies import Box as Box
from ._bodies import Plane as Plane
from ._bodies import Shell as Shell
from ._bodies import Sphere as Sphere
from ._file import read_scene as read_scene
from ._margin import Margin as Margin
from ._motion import Steady as Steady
from ._motion import Vibration as Vibration
from ._prescribed import Prescribed as Prescribed
from ._random import random_spheres as random_spheres
from ._result import Ending as Ending
from ._result import Impacts as Impacts
from ._result import Moment as Moment
from ._result import Way as Way
from ._run import Run as Run
from ._scene import Scene as Scene
from ._simulate import simulate as simulate

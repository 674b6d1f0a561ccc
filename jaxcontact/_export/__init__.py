"""Parameters with which other simulators deliver the same restitution."""

from . import simulators as simulators
from .engine import Engine as Engine
from .engine import engines as engines
from .engine import register_engine as register_engine
from .export import export as export
from .result import Export as Export
from .wanted import Draft as Draft
from .wanted import Wanted as Wanted
from .wanted import matched_stiffness as matched_stiffness

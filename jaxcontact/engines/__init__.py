"""Other simulators: parameters with which they deliver the same restitution, and whole scenes."""

from . import simulators as simulators
from .engine import Draft as Draft
from .engine import Engine as Engine
from .engine import Wanted as Wanted
from .engine import engines as engines
from .engine import matched_stiffness as matched_stiffness
from .engine import register_engine as register_engine
from .export import export as export
from .result import Export as Export

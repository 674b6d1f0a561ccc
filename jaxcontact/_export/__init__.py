"""Parameters with which other simulators deliver the same restitution."""

from . import _engines as _engines
from ._engine import Engine as Engine
from ._engine import engines as engines
from ._engine import register_engine as register_engine
from ._export import export as export
from ._result import Export as Export
from ._wanted import Draft as Draft
from ._wanted import Wanted as Wanted
from ._wanted import matched_stiffness as matched_stiffness

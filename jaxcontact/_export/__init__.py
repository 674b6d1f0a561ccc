"""Parameters that make other simulators deliver the same restitution."""

from ._export import export as export
from ._result import Export as Export

"""Many lanes: a function over grids and samples, in blocks, with labelled results."""

from ._sweep import sweep as sweep
from ._table import Sweep as Sweep

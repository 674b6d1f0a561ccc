"""Sweeps: a function over grids and samples, computed in blocks, with labelled results."""

from ._result import Sweep as Sweep
from ._sweep import sweep as sweep

"""Sweeps: a function over grids and samples, computed in blocks, with labelled results."""

from .result import Sweep as Sweep
from .sweep import sweep as sweep

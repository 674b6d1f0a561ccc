"""A ball that falls, hits and rises again: flights by formula, impacts by the law."""

from .bounce import bounce as bounce
from .result import Bounce as Bounce

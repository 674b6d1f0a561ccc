"""A ball that falls, hits and rises again: flights by formula, impacts by the law."""

from ._bounce import bounce as bounce
from ._result import Bounce as Bounce

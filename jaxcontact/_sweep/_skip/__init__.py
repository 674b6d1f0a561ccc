"""Dependences of a traced function: the arrays to compute over each set of dimensions."""

from ._dependence import Dependence as Dependence
from ._program import Constant as Constant
from ._program import Place as Place
from ._program import Program as Program
from ._program import program_of as program_of
from ._work import Analysis as Analysis
from ._work import Array as Array
from ._work import Group as Group
from ._work import analysis_of as analysis_of
from ._work import flag_key as flag_key
from ._work import is_flag as is_flag

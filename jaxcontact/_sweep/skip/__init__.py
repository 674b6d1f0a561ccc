"""Dependences of a traced function: the arrays to compute over each set of dimensions."""

from .dependence import Dependence as Dependence
from .program import Constant as Constant
from .program import Place as Place
from .program import Program as Program
from .program import program_of as program_of
from .program import programs_in as programs_in
from .work import Analysis as Analysis
from .work import Array as Array
from .work import Group as Group
from .work import analysis_of as analysis_of
from .work import flag_key as flag_key
from .work import is_flag as is_flag

"""Compiled functions with little call overhead, and derivatives outside of a trace."""

from .._entry import traced as traced
from .compiled import FEW as FEW
from .compiled import in_double as in_double
from .compiled import quick as quick
from .compiled import side_by_side as side_by_side
from .compiled import soon_options as soon_options
from .compiled import swift_options as swift_options
from .linear import Map as Map
from .outside import Found as Found
from .outside import derived as derived
from .outside import outside as outside
from .program import program as program

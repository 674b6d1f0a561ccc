"""Pictures: every function draws on the axes it is given, or on new ones, and returns them."""

from ._calibration import calibration as calibration
from ._choice import choice as choice
from ._fit import fit as fit
from ._sweep import sweep as sweep
from ._trajectory import trajectory as trajectory

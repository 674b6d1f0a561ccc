"""Fitting any differentiable prediction to data, with uncertainty."""

from ._bootstrap import Bootstrap as Bootstrap
from ._compare import Candidate as Candidate
from ._compare import Comparison as Comparison
from ._compare import compare_fits as compare_fits
from ._compare import compared as compared
from ._compare import criteria as criteria
from ._compare import table as table
from ._data import FitData as FitData
from ._fit import fit as fit
from ._inference import LEAST_GROUPS as LEAST_GROUPS
from ._inference import Direction as Direction
from ._inference import basis_of as basis_of
from ._loss import Huber as Huber
from ._posterior import Posterior as Posterior
from ._posterior import posterior as posterior
from ._profile import Profile as Profile
from ._result import Fit as Fit
from ._space import Space as Space
from ._space import space_of as space_of
from ._target import groups_of as groups_of
from ._transforms import AbstractTransform as AbstractTransform
from ._transforms import Between as Between
from ._transforms import Fixed as Fixed
from ._transforms import Free as Free
from ._transforms import Positive as Positive

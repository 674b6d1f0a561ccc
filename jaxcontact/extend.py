"""Names for those who extend the library: laws, forms and methods of their own, and other parts.

They check arguments, word messages and columns, describe laws, and draw in the style of the plots.
The laboratory and the engines take these and the public names from the core, nothing else. Each
name is loaded on first use; docs/extend.md says what each is for.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

if _TYPE_CHECKING:
    from ._cache import users_folder as users_folder
    from ._contact import require_contact as require_contact
    from ._entry import NOT_NEGATIVE as NOT_NEGATIVE
    from ._entry import POSITIVE as POSITIVE
    from ._entry import REAL as REAL
    from ._entry import RESTITUTION as RESTITUTION
    from ._entry import Range as Range
    from ._entry import as_array as as_array
    from ._entry import as_numbers as as_numbers
    from ._entry import as_weights as as_weights
    from ._entry import concrete as concrete
    from ._entry import did_you_mean as did_you_mean
    from ._entry import parameter as parameter
    from ._entry import ranges as ranges
    from ._entry import refusal as refusal
    from ._entry import refuses_unknown as refuses_unknown
    from ._entry import rendered as rendered
    from ._entry import require_choice as require_choice
    from ._entry import require_count as require_count
    from ._entry import require_flag as require_flag
    from ._entry import require_kind as require_kind
    from ._entry import require_number as require_number
    from ._entry import require_path as require_path
    from ._fit import CLEAR_AICC as CLEAR_AICC
    from ._fit import LEAST_GROUPS as LEAST_GROUPS
    from ._fit import AbstractErrors as AbstractErrors
    from ._fit import AbstractTransform as AbstractTransform
    from ._fit import Candidate as Candidate
    from ._fit import Comparison as Comparison
    from ._fit import FitData as FitData
    from ._fit import SharedErrors as SharedErrors
    from ._fit import Space as Space
    from ._fit import basis_of as basis_of
    from ._fit import compared as compared
    from ._fit import criteria_of as criteria_of
    from ._fit import groups_of as groups_of
    from ._fit import refit as refit
    from ._fit import sandwich as sandwich
    from ._fit import space_of as space_of
    from ._fit import with_shared as with_shared
    from ._fit.fit import ColumnKeywords as ColumnKeywords
    from ._fit.fit import FitKeywords as FitKeywords
    from ._fit.fit import SearchKeywords as SearchKeywords
    from ._fit.fit import takes as takes
    from ._flight import STANDARD_GRAVITY as STANDARD_GRAVITY
    from ._flight import Flight as Flight
    from ._flight import Floats as Floats
    from ._forms import scale_of as scale_of
    from ._friction.base import require_friction as require_friction
    from ._friction.spring_slider import ratio_of as ratio_of
    from ._impact import method_of as method_of
    from ._impact import problem_of as problem_of
    from ._impact import restitution_is_constant as restitution_is_constant
    from ._impact import restitutions as restitutions
    from ._impact.front_door import SPEED as SPEED
    from ._impact.front_door import sliding_problem as sliding_problem
    from ._impact.oblique.bodies import require_bodies as require_bodies
    from ._impact.result import NUMBERS as NUMBERS
    from ._inverse.columns import EVEN as EVEN
    from ._inverse.columns import MEASURED_RESTITUTION as MEASURED_RESTITUTION
    from ._inverse.columns import column as column
    from ._inverse.columns import for_each as for_each
    from ._inverse.columns import length_guess as length_guess
    from ._inverse.columns import measured as measured
    from ._inverse.columns import not_shrinking as not_shrinking
    from ._inverse.columns import too_long as too_long
    from ._inverse.columns import with_transforms as with_transforms
    from ._inverse.impacts import ImpactModel as ImpactModel
    from ._inverse.impacts import Outcome as Outcome
    from ._inverse.impacts import transforms_of as transforms_of
    from ._laws import AbstractOscillator as AbstractOscillator
    from ._laws import constant_laws as constant_laws
    from ._laws import describe as describe
    from ._laws import force_of as force_of
    from ._laws import require_law as require_law
    from ._laws.base import require_exponent as require_exponent
    from ._program import quick as quick
    from ._program import side_by_side as side_by_side
    from ._program import traced as traced
    from ._scene.bodies.bodies import words as words
    from ._scene.file import examples as examples
    from ._text.columns import states_in_csv as states_in_csv
    from ._text.files import FIGURES as FIGURES
    from ._text.files import read_whole as read_whole
    from ._text.files import write_all as write_all
    from ._text.progress import Stages as Stages
    from ._text.progress import progress_of as progress_of
    from ._text.progress import stages_of as stages_of
    from ._text.units import Shown as Shown
    from ._text.units import Unit as Unit
    from ._text.units import label as label
    from ._text.units import quantity as quantity
    from ._text.units import written_unit as written_unit
    from ._text.words import Words as Words
    from ._text.words import counted as counted
    from ._text.words import listed as listed
    from ._text.words import span as span
    from ._text.words import text_table as text_table
    from ._text.words import with_error as with_error
    from ._text.words import wrapped as wrapped
    from .plot._drawing.labels import put_label as put_label
    from .plot._drawing.save import image_of as image_of
    from .plot._drawing.save import render as render
    from .plot._drawing.style import CURVES as CURVES
    from .plot._drawing.style import DATA as DATA
    from .plot._drawing.style import axes_for as axes_for
    from .plot._drawing.style import axes_of as axes_of
    from .plot._drawing.style import legend_above as legend_above

_ROOMS = {
    "_cache": "users_folder",
    "_contact": "require_contact",
    "_entry": (
        "NOT_NEGATIVE POSITIVE REAL RESTITUTION Range as_array as_numbers as_weights concrete "
        "did_you_mean parameter ranges refusal refuses_unknown rendered require_choice "
        "require_count require_flag require_kind require_number require_path"
    ),
    "_fit": (
        "AbstractErrors AbstractTransform CLEAR_AICC Candidate Comparison FitData LEAST_GROUPS "
        "SharedErrors Space basis_of compared criteria_of groups_of refit sandwich space_of "
        "with_shared"
    ),
    "_fit.fit": "ColumnKeywords FitKeywords SearchKeywords takes",
    "_flight": "Flight Floats STANDARD_GRAVITY",
    "_forms": "scale_of",
    "_friction.base": "require_friction",
    "_friction.spring_slider": "ratio_of",
    "_impact": "method_of problem_of restitution_is_constant restitutions",
    "_impact.front_door": "SPEED sliding_problem",
    "_impact.oblique.bodies": "require_bodies",
    "_impact.result": "NUMBERS",
    "_inverse.columns": (
        "EVEN MEASURED_RESTITUTION column for_each length_guess measured not_shrinking too_long "
        "with_transforms"
    ),
    "_inverse.impacts": "ImpactModel Outcome transforms_of",
    "_laws": "AbstractOscillator constant_laws describe force_of require_law",
    "_laws.base": "require_exponent",
    "_program": "quick side_by_side traced",
    "_scene.bodies.bodies": "words",
    "_scene.file": "examples",
    "_text.columns": "states_in_csv",
    "_text.files": "FIGURES read_whole write_all",
    "_text.progress": "Stages progress_of stages_of",
    "_text.units": "Shown Unit label quantity written_unit",
    "_text.words": "Words counted listed span text_table with_error wrapped",
    "plot._drawing.labels": "put_label",
    "plot._drawing.save": "image_of render",
    "plot._drawing.style": "CURVES DATA axes_for axes_of legend_above",
}
_HOME = {name: room for room, names in _ROOMS.items() for name in names.split()}

# Derived, so that each name is listed once.
__all__ = sorted(_HOME)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> _Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(_import_module(f".{_HOME[name]}", __package__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

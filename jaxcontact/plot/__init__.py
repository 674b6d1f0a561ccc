"""Plots: every function draws on the given axes, or on new ones, and returns them."""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

from ._animate import animate as animate
from ._corner import corner as corner
from ._corner import profile as profile
from ._drawing.save import save as save
from ._fit import choice as choice
from ._fit import fit as fit
from ._fit import residuals as residuals
from ._impact import energy as energy
from ._impact import impact as impact
from ._impact import trajectory as trajectory
from ._law import law as law
from ._scene import forces as forces
from ._scene import gaps as gaps
from ._scene import phase as phase
from ._scene import scene as scene
from ._sweep import sweep as sweep

if _TYPE_CHECKING:
    from .._lab.plots import calibration as calibration
    from .._lab.plots import record as record
    from .._lab.plots import sound as sound
    from .._lab.plots import track as track

_OF_THE_LABORATORY = "calibration", "record", "sound", "track"


def __getattr__(name: str) -> _Any:
    # The laboratory stands above this room and imports the shared parts of all plots from it.
    if name not in _OF_THE_LABORATORY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(_import_module("jaxcontact._lab.plots"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_OF_THE_LABORATORY})

"""Plots: every function draws on the given axes, or on new ones, and returns them."""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

from ._animate import animate as animate
from ._corner import corner as corner
from ._corner import profile as profile
from ._drawing.save import save as save
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
    from ..lab.plots import calibration as calibration
    from ..lab.plots import choice as choice
    from ..lab.plots import record as record
    from ..lab.plots import sound as sound
    from ..lab.plots import track as track

_OF_THE_LABORATORY = "calibration", "choice", "record", "sound", "track"


def __getattr__(name: str) -> _Any:
    # The laboratory takes the shared parts of all plots from this room.
    if name not in _OF_THE_LABORATORY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(_import_module("jaxcontact.lab.plots"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_OF_THE_LABORATORY})

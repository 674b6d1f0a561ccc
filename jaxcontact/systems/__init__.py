"""Mechanisms ready to simulate: each function returns a `System`, and where it starts."""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

from ._bouncing_rod import bouncing_rod as bouncing_rod
from ._double_pendulum import double_pendulum as double_pendulum
from ._impact_damper import impact_damper as impact_damper
from ._numbers import SystemStart as SystemStart
from ._shaken_incline import shaken_incline as shaken_incline
from ._slider_crank import slider_crank as slider_crank
from ._slider_in_guide import slider_in_guide as slider_in_guide

if _TYPE_CHECKING:
    from ..engines.from_mjx import from_mjx as from_mjx


def __getattr__(name: str) -> _Any:
    if name != "from_mjx":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return _import_module("jaxcontact.engines.from_mjx").from_mjx


def __dir__() -> list[str]:
    return sorted({*globals(), "from_mjx"})

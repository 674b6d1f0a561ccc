"""Mechanisms ready to simulate: each function returns a `System`, and where it starts."""

from ._bouncing_rod import bouncing_rod as bouncing_rod
from ._double_pendulum import double_pendulum as double_pendulum
from ._from_mjx import from_mjx as from_mjx
from ._impact_damper import impact_damper as impact_damper
from ._numbers import SystemStart as SystemStart
from ._shaken_incline import shaken_incline as shaken_incline
from ._slider_crank import slider_crank as slider_crank
from ._slider_in_guide import slider_in_guide as slider_in_guide

"""What each figure function of this room returns."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Table = dict[str, np.ndarray]
"""Named columns of equal length; a name ends in its SI unit where there is one: `time_s`."""


class Reproduction(NamedTuple):
    """A figure, and the numbers behind it: tables by name, which the command writes as CSV."""

    figure: Figure
    tables: dict[str, Table]

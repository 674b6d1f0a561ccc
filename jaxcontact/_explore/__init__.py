"""The interactive page that shows each law for a chosen e: one file, without a network."""

from ._page import GRIDS as GRIDS
from ._page import page as page

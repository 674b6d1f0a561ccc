"""The interactive page that shows each law for a chosen e: one file, without a network."""

from .page import GRIDS as GRIDS
from .page import page as page

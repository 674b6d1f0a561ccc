"""The page on which one drags e and sees what each law makes of it: one file, without a network."""

from ._page import GRIDS as GRIDS
from ._page import page as page

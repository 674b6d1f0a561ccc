"""Reproduction of Hu & Guo (2015): figures, tables, and published numbers beside computed ones."""

from ._ball import ball_table as ball_table
from ._ball import bouncing as bouncing
from ._ball import fig8 as fig8
from ._ball import fig9 as fig9
from ._ball import fig10 as fig10
from ._compression import fig4 as fig4
from ._damping import fig5 as fig5
from ._damping import fig6 as fig6
from ._drawing import Reproduction as Reproduction
from ._drawing import Table as Table
from ._impacts import fig3 as fig3
from ._numbers import PUBLISHED as PUBLISHED
from ._numbers import Number as Number
from ._numbers import Published as Published
from ._numbers import markdown as markdown
from ._numbers import numbers as numbers

FIGURES = {
    figure.__name__: figure for figure in (fig3, fig4, fig5, fig6, fig8, fig9, fig10, bouncing)
}
"""Every figure of this room by its name."""

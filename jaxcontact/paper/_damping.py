"""Figs. 5 and 6: the damping factor and the delivered restitution over e."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .. import get_law, restitution
from ._drawing import FOUR_LAWS, REFERENCE, Panel, Reproduction, Table, drawn

GRID = np.linspace(0.005, 1.0, 200)
"""Values of e_in; α of two laws diverges below."""

NEAR_ZERO = 1e-12
"""Stand-in for e → 0; α is a power of e there to as many digits."""

_CEILING = 10.0

# The name, the label and the style of each curve.
_CURVES = [(law.key, {**law.look, "linewidth": 1.3, "label": law.name}) for law in FOUR_LAWS]
_CURVES.append(("exact", {**REFERENCE, "label": "exact"}))
_INPUT = r"input restitution $e_\mathrm{in}$"


def fig5() -> Reproduction:
    """Plot α(e_in) of the four laws, with the exact law for comparison.

    Tables: "damping_factor", α on a grid; "limits", per law α and e α for e → 0, and α and its
    derivative at e = 1.
    """
    table: Table = {"e_in": GRID}
    table |= {name: np.asarray(_alpha(name, jnp.asarray(GRID))) for name, _ in _CURVES}
    frame = {"xlim": (0, 1), "ylim": (0, _CEILING), "xlabel": _INPUT, "ylabel": "damping factor α"}
    panel = Panel([(GRID, table[name], look) for name, look in _CURVES], frame)
    names = [law.key for law in FOUR_LAWS]
    near_zero = np.array([float(_alpha(name, NEAR_ZERO)) for name in names])
    slopes = [jax.grad(lambda e, name=name: _alpha(name, e))(1.0) for name in names]
    limits = {
        "law": np.array(names),
        "alpha_towards_0": near_zero,
        "e_alpha_towards_0": NEAR_ZERO * near_zero,
        "alpha_at_1": np.array([float(_alpha(name, 1.0)) for name in names]),
        "slope_at_1": np.array([float(slope) for slope in slopes]),
    }
    return Reproduction(drawn([panel], height=2.7), {"damping_factor": table, "limits": limits})


def _alpha(name: str, e: ArrayLike) -> Float[Array, "..."]:
    return get_law(name, e=e).damping_factor()


STEPS = np.arange(2, 201) / 200
"""Values of e_in: every 0.005 from 0.01 to 1."""

_TENTHS = np.isin(STEPS, np.arange(1, 11) / 10)

RANGES = (0.1, 0.01)
"""Errors are evaluated from each of these to 1: for the table, and for the plotted curve."""


def fig6() -> Reproduction:
    """Plot e_out(e_in) of the four laws and of the exact law, and below it the error e_out - e_in.

    Tables: "curves"; "restitution", e_out at e_in = 0.1, 0.2 ... 1; "errors", the mean and the
    largest |e_out - e_in| of each law.
    """
    curves: Table = {"e_in": STEPS}
    for name, _ in _CURVES:
        curves[name] = np.asarray(restitution(get_law(name, e=jnp.asarray(STEPS))))
    top = [(STEPS, curves[name], look) for name, look in _CURVES]
    off = [(STEPS, curves[name] - STEPS, look) for name, look in _CURVES[:-1]]
    words = r"output restitution $e_\mathrm{out}$", r"error $e_\mathrm{out} - e_\mathrm{in}$"
    panels = [
        Panel(top, {"xlim": (0, 1), "ylim": (0, 1), "ylabel": words[0]}),
        Panel([*off, (None, 0, REFERENCE)], {"ylabel": words[1], "xlabel": _INPUT}),
    ]
    tables = {
        "curves": curves,
        "restitution": {name: values[_TENTHS] for name, values in curves.items()},
        "errors": _errors(curves),
    }
    return Reproduction(drawn(panels, height=4.4, share="x"), tables)


def _errors(curves: Table) -> Table:
    names = [name for name, _ in _CURVES]
    errors: Table = {"law": np.array(names)}
    off = np.abs(np.array([curves[name] for name in names]) - STEPS)
    for start in RANGES:
        inside = start <= STEPS
        e = STEPS[inside]
        # The mean over e_in, not over grid points: the ends have half weight.
        mean = np.trapezoid(off[:, inside], e, axis=1) / (e[-1] - e[0])
        errors[f"mean_error_from_{start:g}"] = mean
        errors[f"largest_error_from_{start:g}"] = off[:, inside].max(axis=1)
    return errors

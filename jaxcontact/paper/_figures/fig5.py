"""Fig. 5: the damping factor α against the input restitution."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..._laws import get_law
from .._reproduction import Reproduction, Table
from .style import FOUR_LAWS, REFERENCE, legend_above, sheet

GRID = np.linspace(0.005, 1.0, 200)
"""Values of e_in; α of two laws diverges below."""

NEAR_ZERO = 1e-12
"""Stand-in for e → 0; α is a power of e there to as many digits."""

_CEILING = 10.0


def fig5() -> Reproduction:
    """Plot α(e_in) of the four laws, with the exact law for comparison.

    Tables: "damping_factor", α on a grid; "limits", per law α and e α for e → 0, and α and its
    derivative at e = 1.
    """
    figure, (ax,) = sheet(height=2.7)
    table: Table = {"e_in": GRID}
    for law in FOUR_LAWS:
        alpha = table[law.key] = np.asarray(_alpha(law.key, jnp.asarray(GRID)))
        ax.plot(GRID, alpha, color=law.colour, linestyle=law.style, linewidth=1.3, label=law.name)
    exact = table["exact"] = np.asarray(_alpha("exact", jnp.asarray(GRID)))
    ax.plot(GRID, exact, **REFERENCE, label="exact")
    ax.set_xlim(0, 1)
    ax.set_ylim(0, _CEILING)
    ax.set_xlabel(r"input restitution $e_\mathrm{in}$")
    ax.set_ylabel("damping factor α")
    legend_above(figure, ax)
    return Reproduction(figure, {"damping_factor": table, "limits": _limits()})


def _limits() -> Table:
    names = [law.key for law in FOUR_LAWS]
    near_zero = np.array([float(_alpha(name, NEAR_ZERO)) for name in names])
    slopes = [jax.grad(lambda e, name=name: _alpha(name, e))(1.0) for name in names]
    return {
        "law": np.array(names),
        "alpha_towards_0": near_zero,
        "e_alpha_towards_0": NEAR_ZERO * near_zero,
        "alpha_at_1": np.array([float(_alpha(name, 1.0)) for name in names]),
        "slope_at_1": np.array([float(slope) for slope in slopes]),
    }


def _alpha(name: str, e: ArrayLike) -> Float[Array, "..."]:
    return get_law(name, e=e).damping_factor()

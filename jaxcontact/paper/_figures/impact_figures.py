"""Figs. 3, 5 and 6: impacts in time, the damping factor, and the delivered e, over e."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..._impact import restitution
from ..._laws import get_law
from ..._text.units import label
from .._impacts import CASES, Reproduction, Table, impacts, long_table
from .style import FOUR_LAWS, REFERENCE, VELOCITY, legend_above, sheet


def fig3() -> Reproduction:
    """Plot the whole impact of both cases, with the turn as a dotted line.

    Tables: "motion" (case, time, deformation, velocity) and "impact". The latter lists for each
    case α = c v0/K, the delivered restitution, the duration, and the time and depth of the turn.
    """
    solved = impacts()
    figure, axes = sheet(2, 2, height=3.0)
    for i, case in enumerate(CASES):
        top, bottom = axes[i], axes[2 + i]
        time, turn = solved.time[i] * 1e6, float(solved.compression_time[i]) * 1e6
        top.axhline(0, color="0.7", linewidth=0.6)
        top.plot(time, solved.velocity[i], color="black", linewidth=1.2)
        bottom.plot(time, solved.indentation[i] * 1e6, color="black", linewidth=1.2)
        for ax in (top, bottom):
            ax.axvline(turn, color="0.5", ls=":", linewidth=0.8)
            ax.set_xlim(0, float(time[-1]))
            ax.locator_params(axis="x", nbins=4)
        top.tick_params(labelbottom=False)
        top.title.set_text(case.label)
        top.set_ylim(-1.1 * case.velocity, 1.1 * case.velocity)
        top.set_yticks([-case.velocity, 0, case.velocity])
        bottom.set_ylim(bottom=0)
        bottom.set_xlabel(label("time", prefix="µ"))
    axes[0].set_ylabel(VELOCITY)
    axes[2].set_ylabel(label("indentation", "deformation", prefix="µ"))
    number = np.arange(1, len(CASES) + 1)
    motion = {
        "case": number[:, None],
        "time_s": solved.time,
        "deformation_m": solved.indentation,
        "velocity_m_per_s": solved.velocity,
    }
    outcome = {
        "case": number,
        "impact_velocity_m_per_s": np.array([case.velocity for case in CASES]),
        "alpha": solved.alpha,
        "restitution": solved.restitution,
        "duration_s": solved.duration,
        "compression_time_s": solved.compression_time,
        "max_deformation_m": solved.max_indentation,
    }
    return Reproduction(figure, {"motion": long_table(motion), "impact": outcome})


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


STEPS = np.arange(2, 201) / 200
"""Values of e_in: every 0.005 from 0.01 to 1."""

_TENTHS = np.isin(STEPS, np.arange(1, 11) / 10)

RANGES = (0.1, 0.01)
"""Errors are evaluated from each of these to 1: for the table, and for the plotted curve."""

_NAMES = (*(law.key for law in FOUR_LAWS), "exact")


def fig6() -> Reproduction:
    """Plot e_out(e_in) of the four laws and of the exact law, and below it the error e_out - e_in.

    Tables: "curves"; "restitution", e_out at e_in = 0.1, 0.2 ... 1; "errors", the mean and the
    largest |e_out - e_in| of each law.
    """
    curves: Table = {"e_in": STEPS}
    for name in _NAMES:
        curves[name] = np.asarray(restitution(get_law(name, e=jnp.asarray(STEPS))))
    figure, (top, bottom) = sheet(2, 1, height=4.4, sharex=True)
    for law in FOUR_LAWS:
        look = {"color": law.colour, "linestyle": law.style, "linewidth": 1.3}
        e_out = curves[law.key]
        top.plot(STEPS, e_out, **look, label=law.name)
        bottom.plot(STEPS, e_out - STEPS, **look)
    top.plot(STEPS, curves["exact"], **REFERENCE, label="exact")
    bottom.axhline(0, **REFERENCE)
    top.set_xlim(0, 1)
    top.set_ylim(0, 1)
    top.set_ylabel(r"output restitution $e_\mathrm{out}$")
    bottom.set_ylabel(r"error $e_\mathrm{out} - e_\mathrm{in}$")
    bottom.set_xlabel(r"input restitution $e_\mathrm{in}$")
    legend_above(figure, top)
    tables = {
        "curves": curves,
        "restitution": {name: values[_TENTHS] for name, values in curves.items()},
        "errors": _errors(curves),
    }
    return Reproduction(figure, tables)


def _errors(curves: Table) -> Table:
    errors: Table = {"law": np.array(_NAMES)}
    off = np.abs(np.array([curves[name] for name in _NAMES]) - STEPS)
    for start in RANGES:
        inside = start <= STEPS
        e = STEPS[inside]
        # The mean over e_in, not over grid points: the ends have half weight.
        mean = np.trapezoid(off[:, inside], e, axis=1) / (e[-1] - e[0])
        errors[f"mean_error_from_{start:g}"] = mean
        errors[f"largest_error_from_{start:g}"] = off[:, inside].max(axis=1)
    return errors

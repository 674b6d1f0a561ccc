"""Figs. 3 to 6: impacts in time, the damping factor, and the delivered e, over e. In Fig. 4
velocity against deformation in compression, compared with the assumed profiles. The compression of
a solved impact is a curve v(δ), with the sample points of a regression.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float
from scipy.interpolate import CubicHermiteSpline

from ... import get_law, restitution
from ...extend import label
from .._impacts import CASES, MASS, Reproduction, SolvedImpacts, Table, impacts, long_table
from .._velocity_profile import VelocityProfile, fit_velocity_profile
from .style import FOUR_LAWS, REFERENCE, VELOCITY, legend_above, sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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


Sampling = Literal["indentation", "time", "velocity squared"]

SAMPLINGS: tuple[Sampling, ...] = ("indentation", "time", "velocity squared")


class Compression(NamedTuple):
    """Compression from touch to turn: times in s, δ in m, δ' in m/s, and a spline of δ'²."""

    time: np.ndarray
    indentation: np.ndarray
    velocity: np.ndarray
    square: CubicHermiteSpline

    @property
    def max_indentation(self) -> float:
        """δ_m, in m."""
        return float(self.indentation[-1])

    def velocity_at(self, indentation: np.ndarray) -> np.ndarray:
        """Return δ' in m/s; exactly zero at the turn, where rounding errors would remain."""
        square = np.maximum(self.square(indentation), 0)
        return np.sqrt(np.where(indentation < self.max_indentation, square, 0))

    def positions(self, sampling: Sampling, intervals: int) -> np.ndarray:
        """Return `intervals` + 1 values of δ in m from touch to turn, spaced equally in `sampling`.

        Their positions come from linear interpolation, whose error moves a sample along the curve
        only.
        """
        if sampling == "indentation":
            return np.linspace(0, self.max_indentation, intervals + 1)
        scale = self.time if sampling == "time" else -np.square(self.velocity)
        equal = np.linspace(scale[0], scale[-1], intervals + 1)
        return np.interp(equal, scale, self.indentation)


def compression(impacts: SolvedImpacts, case: int) -> Compression:
    """Return the compression of one case: the samples before the turn, and the turn."""
    deepest = float(impacts.max_indentation[case])
    moment = float(impacts.compression_time[case])
    # The turn is that of the closed form; the samples match it to the tolerance of their solve.
    before = (impacts.time[case] < moment) & (impacts.indentation[case] < deepest)

    def with_turn(samples: np.ndarray, turn: float) -> np.ndarray:
        return np.append(samples[case][before], turn)

    time = with_turn(impacts.time, moment)
    depth = with_turn(impacts.indentation, deepest)
    speed = with_turn(impacts.velocity, 0.0)
    force = with_turn(impacts.force, float(impacts.turning_force[case]))
    # δ'² is smooth in δ at the turn, while δ' is not. Its slope is known: d(δ'²)/dδ = 2 δ'' = -2
    # F/m.
    return Compression(time, depth, speed, CubicHermiteSpline(depth, speed**2, -2 * force / MASS))


INTERVALS = 1000
"""Intervals between the samples of a regression."""

FEWER = (20, 50, 200, 1000)
"""Numbers of intervals that divide `INTERVALS`."""

DEFAULT: tuple[Sampling, bool] = ("indentation", False)
"""Samples uniform in δ, the residual in δ': a fit of the curve in Fig. 4."""

_RESIDUALS = {False: "velocity", True: "velocity squared"}


def regress(
    curve: Compression,
    sampling: Sampling = DEFAULT[0],
    squared: bool = DEFAULT[1],
    intervals: int = INTERVALS,
) -> VelocityProfile:
    """Return the profile closest to a compression; see `fit_velocity_profile`."""
    depth = curve.positions(sampling, INTERVALS)
    # Weights select fewer samples, so that only one length is compiled.
    chosen = np.arange(INTERVALS + 1) % (INTERVALS // intervals) == 0
    return fit_velocity_profile(depth, curve.velocity_at(depth), weights=chosen, squared=squared)


def regression_tables(curves: list[Compression]) -> dict[str, Table]:
    """Return the tables "regression", "band" and "samples" of Fig. 4, for both cases."""
    number = np.arange(1, len(CASES) + 1)
    choices = list(itertools.product(SAMPLINGS, _RESIDUALS))
    fits = [[regress(curve, *choice) for choice in choices] for curve in curves]
    beta = np.array([[fit.beta for fit in row] for row in fits])
    residual = np.array([[fit.residual for fit in row] for row in fits])
    published = np.array([case.beta for case in CASES])
    default = beta[:, choices.index(DEFAULT)]
    low, high = beta.min(axis=1), beta.max(axis=1)
    fewer = np.array([[regress(curve, intervals=n).beta for n in FEWER] for curve in curves])
    regression = {
        "case": number[:, None],
        "uniform_in": [sampling for sampling, _ in choices],
        "residual_in": [_RESIDUALS[squared] for _, squared in choices],
        "beta": beta,
        "published_beta": published[:, None],
        "difference": beta - published[:, None],
        "rms_residual": residual,
    }
    return {
        "regression": long_table(regression),
        "band": {
            "case": number,
            "published_beta": published,
            "beta": default,
            "difference": default - published,
            "lowest_beta": low,
            "highest_beta": high,
            "published_inside": (low <= published) & (published <= high),
        },
        "samples": long_table({"case": number[:, None], "intervals": FEWER, "beta": fewer}),
    }


_MARKERS = 40
"""Intervals between the circles of the numerical solution."""

_CLOSE = 0.1
"""Forms that stay closer than this to the solution appear in the panel of differences."""


class Form(NamedTuple):
    """An assumed profile: δ'/v0 as a function of δ/δ_m."""

    name: str
    profile: Callable[[np.ndarray], np.ndarray]
    colour: str
    style: str | tuple[int, tuple[int, ...]]

    @property
    def look(self) -> dict[str, Any]:
        """Line style of the form."""
        return {"color": self.colour, "linestyle": self.style, "linewidth": 1.1}


def _power(beta: float | np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    return lambda u: np.sqrt(1 - u**beta)


# Colours of Okabe and Ito again; forms are not laws and have their own styles.
FORMS = (
    Form("β = 5/2", _power(2.5), "#0072B2", "--"),
    Form("β = 2", _power(2.0), "#D55E00", "-."),
    Form("linear", lambda u: 1 - u, "#CC79A7", ":"),
    Form("step", lambda u: 1 - u**2 * (3 - 2 * u), "#009E73", (0, (6, 1, 1, 1, 1, 1))),
)
"""Eqs. 17, 19, 20 and 21."""


def fig4() -> Reproduction:
    """Plot the compression of both cases with the assumed profiles, and β by regression.

    The lowest panel shows the deviation of the close profiles from the solution, as a fraction of
    v0. Unless a table states otherwise, the fitted β uses samples uniform in deformation and
    residuals in δ'. Tables: "curves"; "regression", β for each sampling and each residual; "band",
    their smallest and largest value, and whether it contains the published one; "samples", β with
    fewer samples; "profiles", the deviation of each form from the solution in units of v0.
    """
    curves = [compression(impacts(), i) for i in range(len(CASES))]
    tables = regression_tables(curves)
    beta = tables["band"]["beta"]
    v0 = np.array([[case.velocity] for case in CASES])
    depth = np.stack([curve.positions("indentation", INTERVALS) for curve in curves])
    solved = np.stack([curve.velocity_at(x) for curve, x in zip(curves, depth, strict=True)])
    u = depth / depth[:, -1:]
    forms = (*FORMS, Form("fitted β", _power(beta[:, None]), "black", "-"))
    assumed = np.stack([v0 * form.profile(u) for form in forms], axis=1)
    off = (assumed - solved[:, None]) / v0[:, None]
    figure, axes = sheet(3, 1, height=6.4)
    for i, case in enumerate(CASES):
        _draw(axes[i], depth[i] * 1e6, solved[i], assumed[i], forms)
        axes[i].title.set_text(case.label)
    _draw_differences(axes[-1], u, off, forms)
    legend_above(figure, axes[0], columns=3)
    number = np.arange(1, len(CASES) + 1)[:, None]
    samples = {"case": number, "deformation_m": depth, "numerical_m_per_s": solved}
    for k, form in enumerate(forms):
        words = re.sub(" = |[ /]", "_", form.name).replace("β", "beta")
        samples[f"{words}_m_per_s"] = assumed[:, k]
    profiles = {
        "case": number,
        "form": [form.name for form in forms],
        "rms_difference": np.sqrt(np.mean(off**2, axis=-1)),
        "largest_difference": np.abs(off).max(axis=-1),
    }
    tables = {"curves": long_table(samples), **tables, "profiles": long_table(profiles)}
    return Reproduction(figure, tables)


def _draw(
    ax: Axes, depth: np.ndarray, solved: np.ndarray, assumed: np.ndarray, forms: tuple[Form, ...]
) -> None:
    for form, velocity in zip(forms, assumed, strict=True):
        ax.plot(depth, velocity, label=form.name, **form.look)
    ax.plot(
        depth[::_MARKERS],
        solved[::_MARKERS],
        "o",
        color="black",
        markersize=3,
        markerfacecolor="white",
        markeredgewidth=0.7,
        label="numerical",
        clip_on=False,
    )
    ax.set_xlim(0, depth[-1] * 1.02)
    ax.set_ylim(bottom=0)
    ax.set_xlabel(label("indentation", "deformation", prefix="µ"))
    ax.set_ylabel(VELOCITY)


def _draw_differences(ax: Axes, u: np.ndarray, off: np.ndarray, forms: tuple[Form, ...]) -> None:
    for i, opacity in enumerate((1.0, 0.4)):
        for form, share in zip(forms, off[i], strict=True):
            if np.abs(share).max() < _CLOSE:
                ax.plot(u[i], share, alpha=opacity, **form.look)
    ax.set_xlim(0, 1.02)
    ax.title.set_text("form minus numerical, case 2 pale")
    ax.set_xlabel("deformation / largest deformation")
    ax.set_ylabel("difference / impact velocity")

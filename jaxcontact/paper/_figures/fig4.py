"""Fig. 4: velocity against deformation in compression, compared with the assumed profiles. The
compression of a solved impact is a curve v(δ), with the sample points of a regression.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ..._calibration import VelocityProfile, fit_velocity_profile
from ..._text.units import label
from .._impacts import CASES, MASS, Reproduction, SolvedImpacts, Table, impacts, long_table
from .style import VELOCITY, legend_above, sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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

"""Fig. 4: velocity against deformation in compression, and the assumed profiles. The compression of
a solved impact is a curve v(δ), with the sample points of a regression.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ..extend import label
from ._drawing import VELOCITY, Panel, Reproduction, Table, drawn, long_table
from ._impacts import CASES, MASS, MICRO, NUMBER, impacts
from ._velocity_profile import VelocityProfile, fit_velocity_profile


class Compression(NamedTuple):
    """Compression from touch to turn: times in s, δ in m, δ' in m/s, and the force in N."""

    time: np.ndarray
    indentation: np.ndarray
    velocity: np.ndarray
    force: np.ndarray

    def velocity_at(self, depth: np.ndarray) -> np.ndarray:
        """Return δ' in m/s; exactly zero at the turn, where rounding errors would remain."""
        # δ'² is smooth in δ at the turn, while δ' is not. Its slope is known: 2 δ'' = -2 F/m.
        slope = -2 * self.force / MASS
        square = CubicHermiteSpline(self.indentation, self.velocity**2, slope)(depth)
        return np.sqrt(np.where(depth < self.indentation[-1], np.maximum(square, 0), 0))

    def positions(self, sampling: str, intervals: int) -> np.ndarray:
        """Return `intervals` + 1 values of δ in m from touch to turn, spaced equally in `sampling`.

        Their positions come from linear interpolation, whose error moves a sample along the curve
        only.
        """
        if sampling == "indentation":
            return np.linspace(0, self.indentation[-1], intervals + 1)
        scale = self.time if sampling == "time" else -np.square(self.velocity)
        equal = np.linspace(scale[0], scale[-1], intervals + 1)
        return np.interp(equal, scale, self.indentation)


def compression(solved: SimpleNamespace, case: int) -> Compression:
    """Return the compression of one case: the samples before the turn, and the turn."""
    # The turn is that of the closed form; the samples match it to the tolerance of their solve.
    turn = solved.compression_time, solved.max_indentation, np.zeros(2), solved.turning_force
    samples = solved.time, solved.indentation, solved.velocity, solved.force
    before = (samples[0][case] < turn[0][case]) & (samples[1][case] < turn[1][case])
    ends = zip(samples, turn, strict=True)
    return Compression(*(np.append(values[case][before], end[case]) for values, end in ends))


INTERVALS = 1000
"""Intervals between the samples of a regression."""

FEWER = (20, 50, 200, 1000)
"""Numbers of intervals that divide `INTERVALS`."""

_RESIDUALS = {False: "velocity", True: "velocity squared"}
_CHOICES = list(itertools.product(("indentation", "time", "velocity squared"), _RESIDUALS))
"""The samples are uniform in these, and the residual is that of δ' or its square. The first one is
a fit of the curve in Fig. 4.
"""


def regress(
    curve: Compression, sampling: str = "indentation", squared: bool = False, every: int = 1
) -> VelocityProfile:
    """Return the profile closest to a compression; see `fit_velocity_profile`."""
    depth = curve.positions(sampling, INTERVALS)
    # Weights select fewer samples, so that only one length is compiled.
    chosen = np.arange(INTERVALS + 1) % every == 0
    return fit_velocity_profile(depth, curve.velocity_at(depth), weights=chosen, squared=squared)


def regression_tables(curves: list[Compression]) -> dict[str, Table]:
    """Return the tables "regression", "band" and "samples" of Fig. 4, for both cases."""
    fits = [[regress(curve, *choice) for choice in _CHOICES] for curve in curves]
    beta = np.array([[fit.beta for fit in row] for row in fits])
    published = np.array([case.beta for case in CASES])
    low, high = beta.min(axis=1), beta.max(axis=1)
    fewer = [[regress(curve, every=INTERVALS // n).beta for n in FEWER] for curve in curves]
    regression = {
        "case": NUMBER[:, None],
        "uniform_in": [sampling for sampling, _ in _CHOICES],
        "residual_in": [_RESIDUALS[squared] for _, squared in _CHOICES],
        "beta": beta,
        "published_beta": published[:, None],
        "difference": beta - published[:, None],
        "rms_residual": np.array([[fit.residual for fit in row] for row in fits]),
    }
    return {
        "regression": long_table(regression),
        "band": {
            "case": NUMBER,
            "published_beta": published,
            "beta": beta[:, 0],
            "difference": beta[:, 0] - published,
            "lowest_beta": low,
            "highest_beta": high,
            "published_inside": (low <= published) & (published <= high),
        },
        "samples": long_table({"case": NUMBER[:, None], "intervals": FEWER, "beta": fewer}),
    }


_MARKERS = 40
"""Intervals between the circles of the numerical solution."""

_CLOSE = 0.1
"""Forms that stay closer than this to the solution appear in the panel of differences."""


def _power(beta: float | np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    return lambda u: np.sqrt(1 - u**beta)


# Name, δ'/v0 as a function of δ/δ_m, colour and line. Colours of Okabe and Ito again; forms are not
# laws and have their own styles.
FORMS: tuple[tuple[str, Callable[[np.ndarray], np.ndarray], str, Any], ...] = (
    ("β = 5/2", _power(2.5), "#0072B2", "--"),
    ("β = 2", _power(2.0), "#D55E00", "-."),
    ("linear", lambda u: 1 - u, "#CC79A7", ":"),
    ("step", lambda u: 1 - u**2 * (3 - 2 * u), "#009E73", (0, (6, 1, 1, 1, 1, 1))),
)
"""The assumed profiles, Eqs. 17, 19, 20 and 21."""


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
    v0 = np.array([[case.velocity] for case in CASES])
    depth = np.stack([curve.positions("indentation", INTERVALS) for curve in curves])
    solved = np.stack([curve.velocity_at(x) for curve, x in zip(curves, depth, strict=True)])
    u = depth / depth[:, -1:]
    forms = (*FORMS, ("fitted β", _power(tables["band"]["beta"][:, None]), "black", "-"))
    assumed = np.stack([v0 * profile(u) for _, profile, *_ in forms], axis=1)
    off = (assumed - solved[:, None]) / v0[:, None]
    looks = [{"label": name, "color": color, "ls": line} for name, _, color, line in forms]
    circle = {"marker": "o", "ls": "", "ms": 3, "mfc": "white", "mew": 0.7, "color": "black"}
    circle |= {"label": "numerical", "clip_on": False}
    panels = []
    for i, case in enumerate(CASES):
        x = MICRO * depth[i]
        lines = [(x, y, {**look, "lw": 1.1}) for y, look in zip(assumed[i], looks, strict=True)]
        frame = {"xlim": (0, x[-1] * 1.02), "ylim": (0, None), "ylabel": VELOCITY}
        frame["xlabel"] = label("indentation", "deformation", prefix="µ")
        circles = x[::_MARKERS], solved[i, ::_MARKERS], circle
        panels.append(Panel([*lines, circles], frame, case.label))
    lines = [
        (u[i], one, {**look, "lw": 1.1, "alpha": opacity})
        for i, opacity in enumerate((1.0, 0.4))
        for one, look in zip(off[i], looks, strict=True)
        if np.abs(one).max() < _CLOSE
    ]
    words = "deformation / largest deformation", "difference / impact velocity"
    frame = {"xlim": (0, 1.02), "xlabel": words[0], "ylabel": words[1]}
    panels.append(Panel(lines, frame, "form minus numerical, case 2 pale"))
    number = NUMBER[:, None]
    samples = {"case": number, "deformation_m": depth, "numerical_m_per_s": solved}
    for k, (name, *_) in enumerate(forms):
        words = re.sub(" = |[ /]", "_", name).replace("β", "beta")
        samples[f"{words}_m_per_s"] = assumed[:, k]
    profiles = {
        "case": number,
        "form": [name for name, *_ in forms],
        "rms_difference": np.sqrt(np.mean(off**2, axis=-1)),
        "largest_difference": np.abs(off).max(axis=-1),
    }
    tables = {"curves": long_table(samples), **tables, "profiles": long_table(profiles)}
    return Reproduction(drawn(panels, height=6.4, legend=3), tables)

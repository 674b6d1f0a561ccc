"""Fig. 4: velocity against deformation in compression, beside the profiles that were assumed."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .._units import label
from ._cases import CASES, impacts
from ._compression import Compression, compression
from ._regression import INTERVALS, regression_tables
from ._reproduction import Reproduction, Table
from ._style import VELOCITY, legend_above, sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MARKERS = 40
"""Intervals between the circles of the numerical solution."""

_CLOSE = 0.1
"""Forms that stay nearer than this to the solution are drawn in the panel of differences."""


class Form(NamedTuple):
    """An assumed profile: δ'/v0 as a function of δ/δ_m."""

    name: str
    profile: Callable[[np.ndarray], np.ndarray]
    colour: str
    style: str | tuple[int, tuple[int, ...]]


def _power(beta: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda u: np.sqrt(1 - u**beta)


# Okabe and Ito's colours again; forms are not laws and have styles of their own.
FORMS = (
    Form("β = 5/2", _power(2.5), "#0072B2", "--"),
    Form("β = 2", _power(2.0), "#D55E00", "-."),
    Form("linear", lambda u: 1 - u, "#CC79A7", ":"),
    Form("step", lambda u: 1 - u**2 * (3 - 2 * u), "#009E73", (0, (6, 1, 1, 1, 1, 1))),
)
"""Eqs. 17, 19, 20 and 21."""


def fig4() -> Reproduction:
    """The compression of both cases beside the assumed profiles, and β by regression.

    The lowest panel has what separates the close ones from the solution, as a share of v0.
    The fitted β, unless a table says otherwise, is that of samples uniform in deformation and
    residuals in δ'. Tables: "curves"; "regression", β for each spacing of the samples and each
    residual; "band", the least and the largest of these, and whether the published value lies
    between them; "samples", β with fewer samples; "profiles", how far each form is from the
    solution, in units of v0.
    """
    curves = [compression(impacts(), i) for i in range(len(CASES))]
    tables = regression_tables(curves)
    beta = tables["band"]["beta"]
    figure, axes = sheet(3, 1, height=6.4)
    sampled, distances = [], []
    for i, curve in enumerate(curves):
        forms = (*FORMS, Form("fitted β", _power(beta[i]), "black", "-"))
        columns = _columns(i, curve, forms)
        _draw(axes[i], i, columns, forms)
        _draw_differences(axes[-1], i, columns, forms)
        sampled.append(columns)
        distances.append(_distances(i, columns, forms))
    legend_above(figure, axes[0], columns=3)
    return Reproduction(
        figure, {"curves": _stack(sampled), **tables, "profiles": _stack(distances)}
    )


def _columns(i: int, curve: Compression, forms: tuple[Form, ...]) -> Table:
    depth = curve.positions("indentation", INTERVALS)
    u, v0 = depth / curve.max_indentation, CASES[i].velocity
    columns = {
        "case": np.full(len(u), i + 1),
        "deformation_m": depth,
        "numerical_m_per_s": curve.velocity_at(depth),
    }
    return columns | {_column(form): v0 * form.profile(u) for form in forms}


def _column(form: Form) -> str:
    return (
        f"{form.name}_m_per_s".replace(" = ", "_")
        .replace("β", "beta")
        .replace(" ", "_")
        .replace("/", "_")
    )


def _distances(i: int, columns: Table, forms: tuple[Form, ...]) -> Table:
    off = np.array([columns[_column(form)] - columns["numerical_m_per_s"] for form in forms])
    off = off / CASES[i].velocity
    return {
        "case": np.full(len(forms), i + 1),
        "form": np.array([form.name for form in forms]),
        "rms_difference": np.sqrt(np.mean(off**2, axis=1)),
        "largest_difference": np.abs(off).max(axis=1),
    }


def _stack(tables: list[Table]) -> Table:
    return {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}


def _draw(ax: Axes, i: int, columns: Table, forms: tuple[Form, ...]) -> None:
    depth = columns["deformation_m"] * 1e6
    for form in forms:
        ax.plot(
            depth,
            columns[_column(form)],
            color=form.colour,
            linestyle=form.style,
            linewidth=1.1,
            label=form.name,
        )
    ax.plot(
        depth[::_MARKERS],
        columns["numerical_m_per_s"][::_MARKERS],
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
    ax.title.set_text(CASES[i].label)
    ax.set_xlabel(label("indentation", "deformation", prefix="µ"))
    ax.set_ylabel(VELOCITY)


def _draw_differences(ax: Axes, i: int, columns: Table, forms: tuple[Form, ...]) -> None:
    u = columns["deformation_m"] / columns["deformation_m"][-1]
    for form in forms:
        off = (columns[_column(form)] - columns["numerical_m_per_s"]) / CASES[i].velocity
        if np.abs(off).max() < _CLOSE:
            pale = 1.0 if i == 0 else 0.4
            ax.plot(u, off, color=form.colour, linestyle=form.style, linewidth=1.1, alpha=pale)
    ax.set_xlim(0, 1.02)
    ax.title.set_text("form less numerical, case 2 pale")
    ax.set_xlabel("deformation / largest deformation")
    ax.set_ylabel("difference / impact velocity")

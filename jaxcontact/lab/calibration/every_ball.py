"""One law fitted to each ball of a file, as `calibrate` fits it to one."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np

from ... import Contact, FitStatus
from ...extend import Flight, counted, describe, text_table, with_error
from ..choice.kind import Estimate, Kind, is_identifiable
from ..choice.kinds import kinds_of
from ..choice.table import ChoiceTable, errors_of
from ..pairs.outliers import find_outliers
from ..pairs.pairs import LEAST_PAIRS
from ..recordings import RecordedPairs, Recording, make_pairs
from .summary_data import AtSpeed, at_speeds

_SHOWN = 20
"""Balls that are printed without --details."""


@dataclasses.dataclass(frozen=True)
class BallFit:
    """The law of one ball: its `estimates` and e at the speeds asked for, without failed ones.

    `pairs` were fitted, and the rows `left_out` are off the trend. `adequate`: whether the law
    describes the pairs, None if undecided. `reference` in m/s is that of a power law.
    """

    ball: str
    status: FitStatus
    pairs: int
    left_out: tuple[int, ...]
    estimates: tuple[Estimate, ...] = ()
    at: tuple[AtSpeed, ...] = ()
    adequate: bool | None = None
    reference: float | None = None


def calibrate_each(
    recordings: Mapping[str, Recording],
    law: str,
    *,
    flight: Flight,
    mass: float | None,
    stiffness: float | None,
    at: Sequence[float],
    tell: Callable[..., None],
) -> list[BallFit]:
    """Fit one law to each ball; without speeds `at`, e is given at the median of all speeds."""
    kind = next(one for one in kinds_of(law, 1.5) if one.law == law)
    known = frozenset(itertools.compress(("mass", "stiffness"), (mass, stiffness)))
    with jax.enable_x64(True):
        contact = Contact(mass or 1.0, stiffness or 1.0, exponent=1.5)
        every = {ball: make_pairs(one, flight) for ball, one in recordings.items()}
        speeds = np.concatenate([pairs.velocity for pairs in every.values()])
        if not at and speeds.size:
            at = [float(f"{np.median(speeds):.2g}")]
        fits = []
        for number, (ball, pairs) in enumerate(every.items()):
            fits.append(_fit_of(ball, pairs, kind, contact, known, at))
            tell(number + 1, len(every))
    return fits


def _fit_of(
    ball: str,
    pairs: RecordedPairs,
    kind: Kind,
    contact: Contact,
    known: frozenset[str],
    at: Sequence[float],
) -> BallFit:
    if len(pairs) < LEAST_PAIRS:
        return BallFit(ball, FitStatus.TOO_FEW_POINTS, len(pairs), ())
    outliers = find_outliers(pairs)
    keep = ~outliers.flagged
    table = ChoiceTable(pairs, keep, errors_of(pairs, outliers, keep), contact, known)
    left_out = tuple(sorted({*pairs.first_row[~keep].tolist(), *pairs.second_row[~keep].tolist()}))
    count = int(keep.sum())
    if count < LEAST_PAIRS or not table.determines(kind):
        return BallFit(ball, FitStatus.TOO_FEW_POINTS, count, left_out)
    fit = table.fit(kind)
    if not fit.converged:
        return BallFit(ball, FitStatus.NOT_CONVERGED, count, left_out)
    status = FitStatus.CONVERGED if is_identifiable(fit) else FitStatus.NOT_IDENTIFIABLE
    estimates = kind.estimates(fit, contact, known, at[0])
    return BallFit(
        ball,
        FitStatus.AT_BOUND if fit.at_bound else status,
        count,
        left_out,
        # e at a speed is in `at`, with its interval.
        tuple(one for one in estimates if one.name != kind.at_speed.format(at[0])),
        at_speeds(fit, [], table.velocity, at)[2:],
        fit.adequate,
        table.reference if "reference" in describe(kind.law).parameters else None,
    )


def row_of(fit: BallFit) -> dict[str, Any]:
    """Return the numbers of a ball by the headings of the table that is written."""
    row: dict[str, Any] = {"ball": fit.ball, "status": fit.status.name.lower()}
    for one in fit.estimates:
        name = _named(one)
        row |= {name: one.value, f"standard error of {name}": one.standard_error}
    for one in fit.at:
        speed = f"e at {one.velocity:g} m/s"
        row |= {speed: one.restitution, f"{speed}, low": one.low, f"{speed}, high": one.high}
    if fit.reference is not None:
        row["reference (m/s)"] = fit.reference
    row |= {"describes the data": fit.adequate, "pairs": fit.pairs}
    return row | {"rows left out": " ".join(map(str, fit.left_out))}


def text_of(fits: Sequence[BallFit], *, whole: bool) -> str:
    """Return counts, the spread of each number, and the table of balls, cut unless `whole`."""
    counts = FitStatus.names_of(np.array([int(one.status) for one in fits]))
    poor = sum(one.adequate is False for one in fits)
    told = f"; the law does not describe {poor:,}" if poor else ""
    cells = [_cells(one) for one in fits]
    good = [few for one, few in zip(fits, cells, strict=True) if one.status == 0]
    names = list(max(cells, key=len))
    spread = []
    for name in names if good else []:
        values, errors = np.array([few[name] for few in good], float).T
        low, middle, high = np.quantile(values, [0.1, 0.5, 0.9])
        error = np.nanmedian(errors) if np.isfinite(errors).any() else np.nan
        spread.append([name, _number(middle, error), f"{low:.4g}", f"{high:.4g}"])
    lines = [f"{counted(len(fits), ('ball', 'balls'))}: {counts}{told}"]
    if spread:
        header = ["", "median ball", "10 %", "90 %"]
        lines += text_table(spread, header=header, align="<>>>", indent=2)
    shown = list(zip(fits, cells, strict=True))[: None if whole else _SHOWN]
    rows = [
        [
            *(one.ball or "-", str(one.pairs)),
            *(_number(*few[name]) if name in few else "-" for name in names),
            one.status.name.lower() + ", law does not describe it" * (one.adequate is False),
        ]
        for one, few in shown
    ]
    header = ["ball", "pairs", *names, ""]
    lines += ["", *text_table(rows, header=header, align="<>" + ">" * len(names), indent=2)]
    if len(shown) < len(fits):
        lines.append(f"  and {len(fits) - len(shown):,} more; --details prints all")
    return "\n".join(lines)


def _named(one: Estimate) -> str:
    return f"{one.name} ({one.unit})" if one.unit else one.name


def _cells(fit: BallFit) -> dict[str, tuple[float, float | None]]:
    """Return value and printed error of each number: standard errors, half intervals of e(v)."""
    cells = {_named(one): (one.value, one.standard_error) for one in fit.estimates}
    for one in fit.at:
        name = f"e at {one.velocity:g} m/s (95 %)"
        cells[name] = one.restitution, one.half if one.known else None
    return cells


def _number(value: float, error: float | None) -> str:
    if error is None or not np.isfinite(error):
        return f"{value:.3g}"
    return with_error(value, error)

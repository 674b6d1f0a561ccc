"""Wide tables: columns of the same meaning side by side, read one below the other as trials."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..layouts.layout import DROP_HEIGHT, LABELS, LAYOUTS
from ..tables.sheet import Sheet, is_empty

_NUMBERED = re.compile(r"(.*?[^\W\d_])[\s_.#]*(\d+)(\s*[\[({/].*)?")
_COPY = re.compile(r"(.+)\.\d+")
"""A repeated heading, as pandas numbers it."""

_SUMMARY = re.compile(r"(average|avg|mean|std|stdev|sd|standard deviation)\b", re.IGNORECASE)
"""A column after numbered ones that only sums them up."""

_SHRINKS = 0.97
"""Median ratio of a column to the one before below which columns are successive bounces."""


class _Wide(NamedTuple):
    """Positions of `shared` columns and of the `parts` side by side, and the names of a part."""

    shared: list[int]
    parts: list[list[int]]
    names: list[str]


def as_trials(sheet: Sheet) -> Sheet:
    """Return a wide table with its parts one below the other; other sheets as they are.

    Parts are repeated headings ("v, e, v, e"; "h0, h1, h1"), each a trial, or numbered ones ("h0,
    rebound 1, rebound 2"). Numbered columns that shrink along the rows are successive bounces, and
    each row is a trial.
    """
    # pandas calls a column without a heading like this.
    at = [k for k, name in enumerate(sheet.names) if name and not name.startswith("Unnamed: ")]
    found = _repeated(sheet, at) or _numbered(sheet, at)
    if found is None:
        return sheet
    shared, parts, names = found
    rebounds = LAYOUTS["heights"].meaning("rebound_height_m").heading(names[0])
    drop = [k for k in shared if rebounds and _is_drop(sheet.names[k])][: len(names) == 1]
    given = {k: name for k in shared for name in LABELS if LABELS[name].heading(sheet.names[k])}
    # A column `bounce` says that each row is one.
    succession = len(names) == 1 and "bounce" not in given.values()
    succession = succession and _succeed(sheet, parts, drop, "trial" in given.values())
    if drop:
        unit = _common_unit(sheet, sheet.names[drop[0]], names[0])
        if succession:
            shared, parts = [k for k in shared if k != drop[0]], [drop, *parts]
        names = [f"{'height' if succession else 'rebound height'} {unit}".strip()]
        given |= {} if succession else {drop[0]: f"drop height {unit}".strip()}
    names = [*(given.get(k, sheet.names[k]) for k in shared), *names]
    labels = ["trial"] * ("trial" not in given.values()) + ["bounce"] * succession

    def lines(wanted: Sequence[int]) -> list[tuple[int, list[Any]]]:
        rows = _stacked(sheet, _Wide(shared, parts, names), labels, succession)
        return [(number, [whole[i] for i in wanted]) for number, whole in rows]

    what = "bounces in columns, each row a trial" if succession else "each set is a trial"
    notes = [*sheet.notes, f"{len(parts)} sets of columns side by side: {what}"]
    left = [sheet.names[k] for k in at if k not in {*shared, *np.ravel(parts)}]
    notes += [f"not used: {', '.join(left)}"] * bool(left)
    return dataclasses.replace(sheet, names=[*names, *labels], lines=lines, notes=tuple(notes))


def _common_unit(sheet: Sheet, drop: str, rebound: str) -> str:
    """Return the unit of drop and rebound heights; one of them may have none."""
    units = [_unit(drop), _unit(rebound)]
    if all(units) and len({unit.strip("[](){}/ ") for unit in units}) > 1:
        raise sheet.fault(f"is in another unit than the rebounds, {units[1]}", drop)
    return units[0] or units[1]


def _stacked(
    sheet: Sheet, wide: _Wide, labels: list[str], succession: bool
) -> list[tuple[int, list[Any]]]:
    """Return the rows of all parts, each with its number, and with the cells of `labels` last."""
    rows = []
    for k, part in enumerate(wide.parts, 1):
        for number, cells in sheet.lines([*wide.shared, *part]):
            # Parts may have fewer rows than others.
            if all(is_empty(cell) for cell in cells[len(wide.shared) :]):
                continue
            own = {"trial": f"row {number}" if succession else k, "bounce": k}
            rows.append((number, [*cells, *(own[label] for label in labels)]))
            if not succession and "trial" in wide.names:
                here = wide.names.index("trial")
                rows[-1][1][here] = f"{cells[here]}, set {k}"
    return rows


def _are_trials(shared: Sequence[str], part: Sequence[str]) -> bool:
    """Return whether headings make up a layout that may have trials, with some of the part."""
    return any(
        any(one.meaning(column).heading(text) for column in one.measured for text in part)
        and all(
            any(one.meaning(column).heading(text) for text in [*shared, *part])
            for column in one.measured
        )
        for one in LAYOUTS.values()
        if one.name != "instants" and ("trial" in one.columns or "time" not in one.columns)
    )


def _repeated(sheet: Sheet, at: list[int]) -> _Wide | None:
    """Return the repeated block of headings at the end of a header, if one is a measurement."""
    names = [sheet.names[k] for k in at]
    copies = (_COPY.fullmatch(name) for name in names)
    names = [one[1] if one and one[1] in names[:k] else names[k] for k, one in enumerate(copies)]
    if sheet.header_row is None and len({*sheet.names}) < len(sheet.names):
        return None  # a data frame returns columns of one name together
    for first in range(len(names)):
        rest = names[first:]
        for width in range(1, len(rest) // 2 + 1):
            block = rest[:width]
            whole = rest == block * (len(rest) // width)
            if whole and _are_trials(names[:first], block):
                parts = [at[k : k + width] for k in range(first, len(at), width)]
                return _Wide(at[:first], parts, block)
    return None


def _numbered(sheet: Sheet, at: list[int]) -> _Wide | None:
    """Return the columns numbered from 1 at the end of a header: "h1, h2, h3"."""
    while at and _SUMMARY.match(sheet.names[at[-1]]):
        at = at[:-1]
    found = [_NUMBERED.fullmatch(sheet.names[k]) for k in at]
    last = found[-1] if found else None
    if last is None or (count := int(last[2])) < 2 or count > len(at):
        return None
    stem, unit = last[1], last[3] or ""
    run = [one and (one[1], int(one[2]), one[3] or "") for one in found[-count:]]
    shared = at[:-count]
    heading = f"{stem}{unit}"
    drops = [sheet.names[k] for k in shared if _is_drop(sheet.names[k])]
    if drops and (LABELS["trial"].heading(stem) or LABELS["bounce"].heading(stem)):
        heading = f"rebound height {unit or _unit(drops[0])}".strip()
    texts = [sheet.names[k] for k in shared] + ["h0"] * bool(drops)
    # "v1, v2" alone are not two trials of one speed.
    if run != [(stem, k, unit) for k in range(1, count + 1)] or (count == 2 and not drops):
        return None
    columns = [[k] for k in at[-count:]]
    return _Wide(shared, columns, [heading]) if _are_trials(texts, [heading]) else None


def _unit(text: str) -> str:
    found = re.search(r"[\[({/].*", text)
    return found[0].strip() if found else ""


def _is_drop(name: str) -> bool:
    """Return whether a column beside numbered ones holds drop heights."""
    return bool(DROP_HEIGHT.heading(name) or re.match(r"height\b", name, re.IGNORECASE))


def _succeed(sheet: Sheet, parts: list[list[int]], drop: list[int], are_trials: bool) -> bool:
    """Return whether columns are successive bounces, so that each row is a trial."""
    columns = [part[0] for part in parts]
    across, down = _ratios(sheet, columns)
    if across >= _SHRINKS:
        return False
    if drop:
        # Repeats may shrink as well, but lose less from one to the next than from the drop.
        return across**2 <= _ratios(sheet, [drop[0], columns[0]])[0]
    if down < _SHRINKS and not are_trials:
        told = "shrinks as rows do. Add a column `trial` if rows are trials, or else `bounce`"
        raise sheet.fault(told, sheet.names[columns[-1]])
    return True


def _ratios(sheet: Sheet, columns: list[int]) -> tuple[float, float]:
    """Return the median ratio of a column to the one before, and of a row; 1 for texts."""
    try:
        rows = [
            [np.nan if is_empty(cell) else float(cell) for cell in cells]
            for _, cells in sheet.lines(columns)
        ]
    except (TypeError, ValueError):
        return 1.0, 1.0
    values = np.array(rows).reshape(-1, len(columns))
    values[values == 0] = np.nan
    ratios = (values[:, 1:] / values[:, :-1], values[1:] / values[:-1])
    across, down = (float(np.median(r[r == r])) if np.any(r == r) else 1.0 for r in ratios)
    return across, down

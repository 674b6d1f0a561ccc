"""The layout that the columns of a sheet have; or what they lack, and how to say what they hold."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ..layouts.layout import LABELS, LAYOUTS, Layout
from ..tables.heading import Meaning, suggestion
from ..tables.match import Match, Told, match
from ..tables.sheet import RecordingError, Sheet

_UNIT_ALONE = re.compile(r"\[[^\]]*\]")


def layout_of(
    sheet: Sheet, name: str | None, told: Told, meanings: Mapping[str, Mapping[str, Meaning]]
) -> tuple[Layout[Any], Match]:
    """Return the layout called `name`, or the best match, with the places of its columns."""
    layouts = [one for one in LAYOUTS.values() if name in (None, one.name)]
    if not told and sheet.names and not any(_UNIT_ALONE.sub("", text) for text in sheet.names):
        raise _without_headings(sheet)
    found = _matching(layouts, sheet, told, meanings, guessed=name is None and not told)
    if not found:
        raise ValueError(
            "Argument `columns` must name columns of one layout, but names "
            f"{', '.join(told)}; the layouts are "
            + "; ".join(f"{one.name!r} ({', '.join(one.columns)})" for one in layouts)
            + "."
        )
    meant = LAYOUTS[_best(found, told, meanings)]
    made = found[meant.name]
    if isinstance(made, RecordingError):
        raise made
    missing = meant.lacking(made.places)
    if missing and not made.places.keys() - LABELS.keys() and name is None:
        raise _without_known_columns(layouts, sheet, meanings)
    for column in missing:
        others = [text for k, text in enumerate(sheet.names) if k not in made.places.values()]
        near = {column: meant.meaning(column)}
        guess = next((f"; is it {t!r}?" for t in others if t and suggestion(t, near)), "")
        raise sheet.fault(
            f"is missing; {_needed(meant, found, sheet, name is not None)}"
            f"{_how_to_say(sheet, column, made.places.values())}"
            f"{meant.instead.get(column, '')}{guess}{_if_oblique(sheet)}",
            column,
        )
    return meant, made


def _matching(
    layouts: Iterable[Layout[Any]],
    sheet: Sheet,
    told: Told,
    meanings: Mapping[str, Mapping[str, Meaning]],
    *,
    guessed: bool,
) -> dict[str, Match | RecordingError]:
    """Return the match of each layout that the columns may mean, or the fault in them."""
    found: dict[str, Match | RecordingError] = {}
    for one in layouts:
        try:
            made = match(sheet, meanings[one.name], told)
        except RecordingError as error:
            made = error
        if guessed and one.fitted and _only_a_letter(made):
            continue
        if guessed and isinstance(made, Match) and not one.fits(made, sheet):
            continue
        if made is not None:
            found[one.name] = made
    return found


def _best(
    found: Mapping[str, Match | RecordingError],
    told: Told,
    meanings: Mapping[str, Mapping[str, Meaning]],
) -> str:
    """Return the name of the layout that is meant: a complete one, or the one that lacks least."""

    def misfit(one: str) -> tuple[int, bool, int, int]:
        made = found[one]
        there = made.places if isinstance(made, Match) else dict.fromkeys(meanings[one], 0)
        held = sum(name in there for name in LAYOUTS[one].columns)
        lacks = len(LAYOUTS[one].lacking(there))
        return lacks, not there, -held, len(LAYOUTS[one].columns) - held

    complete = [one for one in found if misfit(one)[0] == 0]
    # Columns assigned by their exact name select the layout that has them.
    complete.sort(key=lambda one: -sum(name in LAYOUTS[one].columns for name in told))
    # The message then names only what the nearest layout lacks.
    return complete[0] if complete else min(found, key=misfit)


def _without_known_columns(
    layouts: Iterable[Layout[Any]], sheet: Sheet, meanings: Mapping[str, Mapping[str, Meaning]]
) -> RecordingError:
    """Return the error for a header without any known column."""
    choices = "; ".join(", ".join(one.measured) for one in layouts)
    every = {key: m for one in meanings.values() for key, m in one.items()}
    guesses = (suggestion(text, every) for text in sheet.names if text)
    guess = next(filter(None, guesses), "")
    shown = (sheet.names[0] or "1") if sheet.names else None
    problem = f"no known column; one of these sets is needed: {choices}"
    return sheet.fault(f"{problem}{_how_to_say(sheet)}{guess}{_if_oblique(sheet)}", shown)


def _if_oblique(sheet: Sheet) -> str:
    """Return a hint if headings are those of oblique impacts; "" otherwise."""
    words = ("angle", "tangential", "v_t")
    named = any(word in text.lower() for text in sheet.names for word in words)
    return "; for oblique impacts use `calibrate_friction`" if named else ""


def _needed(
    one: Layout[Any], found: Mapping[str, Match | RecordingError], sheet: Sheet, asked: bool
) -> str:
    """Return which columns are needed beside those present.

    The layout is named only if it was `asked` for.
    """
    if asked:
        return f"the layout {one.name!r} needs the columns {', '.join(one.measured)}"
    made = {
        name: match
        for name, match in found.items()
        if isinstance(match, Match) and match.places.keys() - LABELS.keys()
    }
    lacks = {name: LAYOUTS[name].lacking(match.places) for name, match in made.items()}
    mine = lacks[one.name]
    sets = [", ".join(few) for few in lacks.values() if len(few) == len(mine)]
    beside = [h.text for name, h in made[one.name].headings.items() if name not in LABELS]
    needed = " or ".join(dict.fromkeys([", ".join(mine), *sets]))
    return f"beside {', '.join(beside)} a column {needed} is needed"


def _only_a_letter(made: Match | RecordingError | None) -> bool:
    """Return whether the only matching heading is a single letter, which is ambiguous."""
    if not isinstance(made, Match) or len(made.headings) != 1:
        return False
    (heading,) = made.headings.values()
    return len(heading.text) == 1


def _how_to_say(sheet: Sheet, column: str = "velocity", used: Iterable[int] = ()) -> str:
    """Return how to assign a column whose heading is not recognised and that is not `used`."""
    if sheet.by_keyword or not sheet.names:
        return ""
    free = min({*range(len(sheet.names))} - {*used}, default=0) + 1
    return f'; if a column holds it, name it, as in `columns="{column}={free}"`'


def _without_headings(sheet: Sheet) -> RecordingError:
    """Return the error for numbers without headings: possible meanings, and how to name them."""
    lines = sheet.lines(range(len(sheet.names)))
    row = lines[0][0] if lines else None
    if len(sheet.names) != 1:
        problem = (
            f"has {len(sheet.names)} columns and no header; name them, as in "
            '`columns="speed=1,e=2"` or `columns="drop height=1,rebound height=2"`'
        )
        return RecordingError(problem, sheet.source, row)
    numbers = [_number(cells[0]) for _, cells in lines]
    ratio = float(np.median([b / a for a, b in itertools.pairwise(numbers) if a] or 0))
    readings = (
        (
            f" (then e is about {math.sqrt(ratio):.2f})",
            f" (then e is about {ratio:.2f})",
        )
        if ratio > 0
        else ("", "")
    )
    problem = (
        f"one column without a header may hold heights of successive flights in m{readings[0]} or "
        f"intervals between impacts in s{readings[1]}; choose with "
        '`columns="height=1"` or `columns="interval=1"`'
    )
    return RecordingError(problem, sheet.source, row)


def _number(cell: Any) -> float:
    try:
        return float(cell)
    except (TypeError, ValueError):
        return 0.0

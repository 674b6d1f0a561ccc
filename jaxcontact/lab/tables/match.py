"""Assignment of columns of a table, by their headings or by the user's `columns`."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from ...extend import rendered
from .heading import Heading, Meaning, is_bare, suggestion
from .sheet import Row, Sheet

Told = Mapping[str, int | str]
"""The number of a column, from 1, or its heading, by content."""


@dataclasses.dataclass(frozen=True)
class Match:
    """Positions of the columns of a layout in a table, and their headings."""

    places: Mapping[str, int]
    headings: Mapping[str, Heading]

    def rows(self, sheet: Sheet, last: str | None) -> list[Row]:
        """Return the rows of a sheet, at least one, by the names of the layout, of which one is
        `last`.
        """
        if rows := sheet.rows(self.places, self.headings):
            return rows
        what = "columns" if sheet.header_row is None else "a header"
        raise sheet.fault(f"holds {what} but no measurement", last)

    def notes(self) -> tuple[str, ...]:
        """Return which headings were assigned or converted, if not the column's name."""
        told = []
        for name, heading in self.headings.items():
            unit = heading.unit
            if unit is not None and unit.converts:
                told.append(f'{name} = "{heading.text}" {unit.words}')
            elif heading.text != name:
                shown = f'"{heading.text}"' if heading.text else f"column {self.places[name] + 1}"
                told.append(f"{name} = {shown}")
        return tuple(told)


def as_told(columns: Any, meanings: Collection[Mapping[str, Meaning]]) -> Told:
    """Return the columns of "speed=2,e=5" or of a dict, {} for None.

    Raises ValueError for other input, and for columns that have none of the meanings.
    """
    if columns is None:
        return {}
    given = columns
    if isinstance(columns, str):
        parts = [part.partition("=") for part in columns.split(",") if part.strip()]
        given = {name.strip(): place.strip() for name, _, place in parts}
        if len(given) < len(parts) or not all(map(str.strip, (p for _, _, p in parts))):
            given = None
    good = isinstance(given, Mapping) and all(
        isinstance(name, str) and isinstance(place, int | str) and not isinstance(place, bool)
        for name, place in given.items()
    )
    if not good or not given:
        raise ValueError(
            "Argument `columns` must map names to columns, by number or heading, as in "
            f"'speed=2,e=5' or {{'speed': 2, 'e': 'COR'}}, but is {rendered(columns)}."
        )
    for key in given:
        if not any(_find_meaning(key, one) for one in meanings):
            every = {name: meaning for one in meanings for name, meaning in one.items()}
            raise ValueError(
                f"Argument `columns` names {key!r}, which is no known column; these are "
                f"{', '.join(every)}{suggestion(key, every)}."
            )
    return {
        name: int(place) if isinstance(place, str) and place.isdecimal() else place
        for name, place in given.items()
    }


def match(sheet: Sheet, meanings: Mapping[str, Meaning], told: Told) -> Match | None:
    """Return the columns of a sheet that have a meaning; None if `told` names an unknown one.

    Raises RecordingError for a repeated heading, for two with the same meaning, and for an unknown
    unit.
    """
    places: dict[str, int] = {}
    headings: dict[str, Heading] = {}
    for key, place in told.items():
        named = _find_meaning(key, meanings)
        if named is None:
            return None
        name, asked = named
        places[name] = at = _place(sheet, place)
        unit = asked.unit or meanings[name].unit_in(sheet.names[at])
        headings[name] = Heading(sheet.names[at], unit)
    for name, meaning in sorted(meanings.items(), key=lambda one: bool(one[1].like)):
        if name in places:
            continue
        place = _only_place(sheet, name, meanings, places)
        if place is None:
            continue
        text = sheet.names[place]
        places[name] = place
        headings[name] = meaning.heading(text) or Heading(text)
    _refuse_unknown_units(sheet, meanings, places)
    # Restore the order of the layout, including the columns assigned by the user.
    order = [name for name in meanings if name in places]
    for name in order:
        own, like = headings[name], headings.get(meanings[name].like)
        unit = like.unit if own.unit is None and like is not None else own.unit
        headings[name] = dataclasses.replace(own, unit=unit, is_time=meanings[name].unit == "s")
    return Match({n: places[n] for n in order}, {n: headings[n] for n in order})


def _only_place(
    sheet: Sheet, name: str, meanings: Mapping[str, Meaning], places: Mapping[str, int]
) -> int | None:
    """Return the only free column with a meaning, if any. Raise RecordingError for several."""
    meaning = meanings[name]
    free = [k for k in range(len(sheet.names)) if k not in places.values()]
    # The exact name has precedence over other headings with the same meaning.
    found = [k for k in free if sheet.names[k] == name]
    found = found or [k for k in free if meaning.heading(sheet.names[k])]
    if meaning.like and len(found) > 1:  # "v, ±, e, ±"
        found = [k for k in found if k - 1 == places.get(meaning.like)] or found
    if meaning.like and found:
        _check_beside(sheet, found[0], meaning, meanings, places)
    if len(found) > 1:
        first, second = (sheet.names[k] for k in found[:2])
        twice = first == second
        problem = (
            "appears twice in the header" if twice else f"may be {name}, as may column {first}"
        )
        choice = f'choose one with `columns="{name}={found[0] + 1}"`'
        raise sheet.fault(f"{problem}; {choice}", second)
    return found[0] if found else None


def _refuse_unknown_units(
    sheet: Sheet, meanings: Mapping[str, Meaning], places: Mapping[str, int]
) -> None:
    """Raise RecordingError for a known heading with a unit that is not known."""
    for k, text in enumerate(sheet.names):
        for name, meaning in meanings.items():
            if k not in places.values() and (unit := meaning.unknown_unit(text)):
                problem = (
                    f"{unit!r} is an unknown unit for {name}; convert the numbers and write "
                    f"{meaning.unit or '-'}"
                )
                raise sheet.fault(problem, text)


def _check_beside(
    sheet: Sheet,
    place: int,
    meaning: Meaning,
    meanings: Mapping[str, Meaning],
    places: Mapping[str, int],
) -> None:
    """Refuse "v, ±, e", in which the deviations may belong to either."""
    left = next((name for name, k in places.items() if k == place - 1), meaning.like)
    if left == meaning.like or meanings[left].unit is None or not is_bare(sheet.names[place]):
        return
    raise sheet.fault(
        f"may be the standard deviation of {left} or of {meaning.like}; say so in the heading, as "
        f"in 'u({sheet.names[place - 1]})', or with `columns=\"sigma={place + 1}\"`",
        sheet.names[place],
    )


def _find_meaning(key: str, meanings: Mapping[str, Meaning]) -> tuple[str, Heading] | None:
    for name, meaning in meanings.items():
        if key == name or meaning.heading(key):
            return name, meaning.heading(key) or Heading(key)
    return None


def _place(sheet: Sheet, place: int | str) -> int:
    if isinstance(place, int):
        if not 1 <= place <= len(sheet.names):
            raise sheet.fault(f"has no column {place}; there are {len(sheet.names)}", None)
        return place - 1
    if place not in sheet.names:
        near = suggestion(place, {name: Meaning() for name in sheet.names if name})
        there = f"; its columns are {', '.join(sheet.names)}" if any(sheet.names) else ""
        raise sheet.fault(f"has no column {place!r}{there}{near}", None)
    return list(sheet.names).index(place)


def check_usual(rows: Sequence[Row], meanings: Mapping[str, Meaning]) -> None:
    """Refuse implausible numbers without a written unit."""
    for name, meaning in meanings.items():
        if rows and name in rows[0].values and not rows[0].has_unit(name):
            _check_usual(rows, name, meaning)


def _check_usual(rows: Sequence[Row], name: str, meaning: Meaning) -> None:
    text = (rows[0].headings[name].text if name in rows[0].headings else "") or name
    if meaning.must_say:
        told = " or ".join(f"'{text} [{unit}]'" for unit in meaning.must_say.split(" or "))
        rows[0].refuse(name, f"has no unit, {meaning.must_say}; write it in the heading, {told}")
    if not np.isfinite(meaning.usual):
        return
    middle = float(np.median([row.positive(name) for row in rows]))
    if middle > meaning.usual:
        small = {"m": "cm" if middle < 1000 else "mm", "m/s": "mm/s"}[meaning.unit or "m"]
        rows[0].refuse(
            name,
            f"half of the values are {middle:g} or more, in {meaning.unit} "
            f"{meaning.usual_words}; are they in {small}? write the unit in the heading, "
            f"'{text} [{small}]', or '{text} [{meaning.unit}]' if they are right",
        )

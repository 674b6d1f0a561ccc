"""Named columns of numbers from any table, for fits that are no recordings of bounces."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._flight import Floats
from .._parameter import require_choice
from ._heading import Meaning, suggestion, words
from ._match import as_told, match, unknown_name
from ._sheet import sheet_of
from ._single import VELOCITY, E

COLUMNS: Mapping[str, Meaning] = {
    "velocity": VELOCITY,
    "e": E,
    "duration": Meaning(
        words(
            "duration, contact time, contact duration, duration of contact, collision time, tc, t c"
        ),
        "s",
    ),
    "max_force": Meaning(
        words("max force, maximum force, largest force, peak force, fmax, f max, force max"), "N"
    ),
    "e_in": Meaning(words("e in, ein, e asked, asked, input e, input restitution"), ""),
    "e_out": Meaning(
        words("e out, eout, e delivered, delivered, output e, output restitution"), ""
    ),
    "time": Meaning(words("time, t"), "s"),
    "force": Meaning(words("force, f, normal force, load, contact force"), "N"),
    "indentation": Meaning(
        words("indentation, displacement, deformation, penetration, compression, depth, δ, x"), "m"
    ),
}
"""What the columns of fits mean."""


@dataclasses.dataclass(frozen=True)
class Columns:
    """Columns in SI units by name, all of the shape (n,); NaN for empty cells.

    `source` is where they come from, and `notes` say how they were read.
    """

    source: str
    values: Mapping[str, Floats]
    notes: tuple[str, ...]


def read_columns(
    source: Any,
    names: Sequence[str],
    *,
    needed: Sequence[str],
    columns: Any = None,
    decimal: str | None = None,
) -> Columns:
    """Those of the columns `names` (of `COLUMNS`) that a table has; `needed` ones must be there.

    `source`, `columns` and `decimal` as in `read_recording`. Raises RecordingError and ValueError
    as that does.
    """
    if decimal is not None:
        require_choice("decimal", decimal, (".", ","))
    meanings = {name: COLUMNS[name] for name in names}
    told = {} if columns is None else as_told(columns)
    for key in told:
        if not any(key == name or one.heading(key) for name, one in meanings.items()):
            raise ValueError(unknown_name(key, [meanings]))

    def known(text: str) -> bool:
        return isinstance(text, str) and any(
            text == name or one.heading(text) or one.unknown_unit(text)
            for name, one in meanings.items()
        )

    sheet = sheet_of(source, {}, known, decimal)
    found = match(sheet, meanings, told)
    assert found is not None  # every key that was told is known
    for name in needed:
        if name not in found.places:
            guesses = (suggestion(text, {name: meanings[name]}) for text in sheet.names if text)
            guess = next(filter(None, guesses), "")
            problem = (
                f"is missing; the columns {', '.join(needed)} are needed; if a column holds it, "
                f'say which, as in `columns="{name}=1"`{guess}'
            )
            raise sheet.fault(problem, name)
    rows = found.rows(sheet)
    if not rows:
        raise sheet.fault("holds a header but no measurement", needed[0])
    values = {name: np.array([row.real(name) for row in rows]) for name in found.places}
    return Columns(sheet.source, values, (*found.notes(), *sheet.notes))

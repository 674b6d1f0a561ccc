"""Named columns of numbers from any table, for fits of data other than bounces."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...extend import Floats, require_choice
from ..layouts.instrument import Forces
from ..layouts.layout import LABELS
from ..layouts.speeds import SIGMA_E, VELOCITY, E
from ..signals import CLOCK
from ..tables.heading import FROM_FILE, Meaning, suggestion
from ..tables.match import as_told, check_usual, match
from ..tables.source import sheet_of
from .recording import chosen_ball, headings_of

_SHOWN = 6
"""Largest number of unused columns that a note names."""

_NORMAL = Meaning(
    "normal velocity, normal speed, vn, v n, normal velocity before, v n before", "m/s"
)
"""Beside an angle, these are not the speed."""

COLUMNS: Mapping[str, Meaning] = {
    "velocity": VELOCITY,
    "e": E,
    "sigma": dataclasses.replace(SIGMA_E, like="e"),
    "ball": LABELS["ball"],
    "duration": Meaning(
        "duration, contact time, contact duration, duration of contact, collision time, tc, t c",
        "s",
    ),
    "max_force": Meaning(
        "max force, maximum force, largest force, peak force, fmax, f max, force max", "N"
    ),
    "e_in": Meaning("e in, ein, e asked, asked, input e, input restitution", ""),
    "e_out": Meaning("e out, eout, e delivered, delivered, output e, output restitution", ""),
    "time": CLOCK,
    "force": Forces.meanings["force"],
    "indentation": Meaning(
        "indentation, displacement, deformation, penetration, compression, depth, δ, x", "m"
    ),
    "angle": Meaning(
        "angle, impact angle, angle of impact, incidence, angle of incidence, incidence angle, "
        "incident angle, angle before, θ, theta",
        "rad",
        must_say="deg or rad",
    ),
    "speed": dataclasses.replace(
        VELOCITY, names=", ".join(one for one in VELOCITY.words if one not in _NORMAL.words)
    ),
    "normal_velocity": _NORMAL,
    "tangential_velocity": Meaning(
        "tangential velocity, tangential speed, vt, v t, tangential velocity before, v t before",
        "m/s",
    ),
    "tangential_restitution": Meaning(
        "tangential restitution, tangential coefficient of restitution, tangential cor, "
        "vt'/vt, v t'/v t, v t after/v t, v t after / v t, et, e t, tangential velocity ratio, "
        "tangential speed ratio",
        "",
    ),
    "tangential_rebound": Meaning(
        "tangential rebound, tangential velocity after, tangential speed after, vt', v t', "
        "v t after, tangential rebound velocity, tangential rebound speed",
        "m/s",
    ),
    "rebound_angle": Meaning(
        "rebound angle, angle of rebound, angle after, reflection angle, θ', theta'",
        "rad",
        must_say="deg or rad",
    ),
    "rebound_spin": Meaning(
        "rebound spin, spin, spin after, angular velocity, angular velocity after, "
        "rotational velocity, rotational speed, ω, ω', omega, omega', rotation",
        "rad/s",
    ),
}
"""Meanings of the columns of fits."""


@dataclasses.dataclass(frozen=True)
class TableColumns:
    """Columns in SI units by name, all of shape (n,); NaN for empty cells.

    `source` is their origin, `notes` say how they were read, and `rows` (n,) are their rows in it.
    """

    source: str
    values: Mapping[str, Floats]
    notes: tuple[str, ...]
    rows: tuple[int, ...] = ()


def read_columns(
    source: Any,
    names: Sequence[str],
    *,
    needed: Sequence[str],
    columns: Any = None,
    decimal: str | None = None,
    ball: str | None = None,
    sheet: str | int | None = None,
    every_ball: bool = False,
) -> TableColumns:
    """Read those of the columns `names` (of `COLUMNS`) that a table has; `needed` ones must exist.

    `source`, `columns`, `decimal`, `ball` and `sheet` as in `read_recording`;
    `every_ball` keeps the rows of all. Raises RecordingError and ValueError as that does.
    """
    if decimal is not None:
        require_choice("decimal", decimal, (".", ","))
    meanings = {name: COLUMNS[name] for name in names}
    told = as_told(columns, [meanings])
    table = sheet_of(source, {}, headings_of(meanings), decimal, sheet)
    found = match(table, meanings, told)
    assert found is not None  # every assigned name is known
    for name in needed:
        if name not in found.places:
            guesses = (suggestion(text, {name: meanings[name]}) for text in table.names if text)
            problem = (
                f"is missing; the columns {', '.join(needed)} are needed; if a column holds it, "
                f'name it, as in `columns="{name}=1"`{next(filter(None, guesses), "")}'
            )
            raise table.fault(problem, name)
    rows = found.rows(table, next(iter(needed), None))
    said = [name for name in found.places if meanings[name].must_say]
    check_usual(rows, {name: meanings[name] for name in (*needed, *said)})
    if "ball" in found.places and not every_ball:
        chosen = chosen_ball(ball, [row.place for row in rows], table)
        rows = [row for row in rows if row.place[0] == chosen]
    numbers = [name for name in found.places if name != "ball"]
    values = {name: np.array([row.real(name) for row in rows]) for name in numbers}
    if "time" in found.places:
        table.require_one()
    notes = [*found.notes(), *table.notes, *[FROM_FILE] * ("sigma" in found.places)]
    left = [one for k, one in enumerate(table.names) if one and k not in found.places.values()]
    more = f" and {len(left) - _SHOWN} more" * (len(left) > _SHOWN)
    notes += [f"not used: {', '.join(left[:_SHOWN])}{more}"] * bool(left)
    return TableColumns(table.source, values, tuple(notes), tuple(row.number for row in rows))

"""What an export returns."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from .._contact import Contact
from .._laws import AbstractLaw
from .._text_table import text_table
from .._units import meaning


@dataclasses.dataclass(frozen=True)
class Export:
    """The parameters with which an engine delivers a wanted restitution at one closing speed.

    `engine` and `model` say where they belong; `parameters` holds the numbers and `units` their
    units, by the same names; `snippet` is the text to paste. `target` is the wanted restitution and
    `delivered` that of the engine's law with these parameters, both by `impact`. `law` and
    `contact` are the engine's law as it was solved: `impact(law, contact, velocity)` tells the
    rest. `duration` in s is how long that contact lasts, and `time_step` in s the step at which the
    engine itself was measured to be within `expected_error` (relative, of the restitution, for e of
    0.12 and more); both None where the engine was not run. `limit` says in words what the
    parameters do not reach, `source` where the engine's formula stands.
    """

    engine: str
    model: str
    parameters: Mapping[str, float]
    units: Mapping[str, str]
    snippet: str
    target: float
    delivered: float
    duration: float
    time_step: float | None
    expected_error: float | None
    limit: str
    source: str
    law: AbstractLaw
    contact: Contact

    def __repr__(self) -> str:
        numbers = {name: (value, self.units[name]) for name, value in self.parameters.items()}
        numbers |= {"target": (self.target, ""), "delivered": (self.delivered, "")}
        numbers["duration"] = self.duration, meaning("duration")[1]
        if self.time_step is not None:
            numbers["time_step"] = self.time_step, f"{meaning('time_step')[1]}, or less"
        if self.expected_error is not None:
            numbers["expected_error"] = self.expected_error, ""
        rows = [(name, f"{value:.9g} {unit}".rstrip()) for name, (value, unit) in numbers.items()]
        return "\n".join(
            [
                f"Export to {self.engine}: {self.model}",
                *text_table(rows, indent=2),
                *(f"  | {line}" for line in self.snippet.splitlines()),
                f"  limit: {self.limit}",
                f"  source: {self.source}",
            ]
        )

"""What an export returns."""

from __future__ import annotations

import dataclasses

from .._text_table import text_table
from .._units import quantity
from ._wanted import Draft


@dataclasses.dataclass(frozen=True, kw_only=True)
class Export(Draft):
    """The parameters with which an engine delivers a wanted restitution at one closing speed.

    `engine` and `model` say where they belong; `parameters` holds the numbers and `units` their
    units, by the same names; `snippet` is the text to paste. `target` is the wanted restitution and
    `delivered` that of the engine's law with these parameters, both by `impact`. `law` and
    `contact` are the engine's law as it was solved: `impact(law, contact, velocity)` gives the
    rest. `duration` in s is how long that contact lasts, and `time_step` in s the step at which the
    engine itself was measured to be within `expected_error` (relative, of the restitution, for e of
    0.12 and more), `steps` of them in one contact; all None where the engine was not run. `limit`
    says in words where the parameters do not hold, `source` where the engine's formula is given.
    """

    engine: str
    target: float
    delivered: float
    duration: float

    @property
    def time_step(self) -> float | None:
        """The step in s at which the engine was measured; None if it was not run."""
        return None if self.steps is None else self.duration / self.steps

    def __repr__(self) -> str:
        rows = [(name, f"{x:.9g} {self.units[name]}") for name, x in self.parameters.items()]
        for name in ("target", "delivered", "duration", "time_step", "expected_error"):
            if (x := getattr(self, name)) is not None:
                more = ", or less" if name == "time_step" else ""
                rows.append((name, quantity(name, f"{x:.9g}") + more))
        return "\n".join(
            [
                f"Export to {self.engine}: {self.model}",
                *text_table(rows, indent=2),
                *(f"  | {line}" for line in self.snippet.splitlines()),
                f"  limit: {self.limit}",
                f"  source: {self.source}",
            ]
        )

"""A number with its standard error and unit, as printed."""

from __future__ import annotations

import dataclasses

from ..._text.table import with_error


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A number with unit and standard error; the error is None for the reason `lacking`."""

    name: str
    value: float
    standard_error: float | None
    unit: str
    lacking: str = "not identifiable"

    def __str__(self) -> str:
        """Return `0.8799 ± 0.0010 unit`: two digits of the error, equal places of the value."""
        unit = f" {self.unit}" if self.unit else ""
        if self.standard_error is None:
            return f"{self.value:.3g}{unit} ({self.lacking})"
        return with_error(self.value, self.standard_error) + unit

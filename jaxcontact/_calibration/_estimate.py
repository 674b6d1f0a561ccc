"""A number with its standard error and unit, as it is printed."""

from __future__ import annotations

import dataclasses
import math


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A number with its standard error (None where it is not identifiable) and unit."""

    name: str
    value: float
    standard_error: float | None
    unit: str

    def __str__(self) -> str:
        """`0.8799 ± 0.0010 unit`, the error with two digits and the value with as many places."""
        unit = f" {self.unit}" if self.unit else ""
        if self.standard_error is None:
            return f"{self.value:.3g}{unit} (not identifiable)"
        error = self.standard_error
        if not error > 0:
            return f"{self.value:.6g} ± 0{unit}"
        places = 1 - math.floor(math.log10(error))
        if 0 <= places <= 6 and abs(self.value) < 1e6:
            return f"{self.value:.{places}f} ± {error:.{places}f}{unit}"
        # As many digits of the value as the error warrants.
        size = math.floor(math.log10(abs(self.value))) if self.value else 0
        digits = max(size + places, 0)
        return f"{self.value:.{digits}e} ± {error:.1e}{unit}"

"""The summary of a calibration: plain data with report and export."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from ..._calibration.choice.kinds import kind_of_law, law_in
from ..._contact import Contact
from ..._laws import AbstractLaw
from .full_report import report
from .short_report import short
from .summary_data import SummaryData

_SPEEDS = 17
"""Number of closing speeds of an export, over the measured range."""


@dataclasses.dataclass(frozen=True, repr=False)
class CalibrationSummary(SummaryData):
    __doc__ = SummaryData.__doc__

    def report(self) -> str:
        """Return the full report, verdict first."""
        return report(self)

    def __export__(
        self, contact: Contact | None
    ) -> tuple[AbstractLaw, Contact, Float[np.ndarray, " n"]]:
        """Return law, contact and closing speeds in m/s over the measured range, for `export`.

        With another `contact`, the law is converted to keep e(v). Raises ValueError if no fit
        converged, or if mass or stiffness is unknown.
        """
        if self.law is None:
            raise ValueError("Argument `law` must have a converged fit, but no fit converged.")
        kind = kind_of_law(self.law)
        missing = [name for name in ("mass", "stiffness") if name not in self.given]
        if contact is None and missing:
            words = " and ".join(f"`{name}`" for name in missing)
            raise ValueError(
                f"Argument `contact` is needed: this calibration was made without {words} and "
                f"does not determine {kind.unidentified}. Give `contact=Contact(mass, "
                f"stiffness)`, or calibrate with {words}."
            )
        law = self.law if contact is None else law_in(self.law, self.contact, contact)
        kept = [pair.velocity for pair in self.pairs if not pair.marked]
        speeds = np.geomspace(min(kept), max(kept), _SPEEDS)
        return law, self.contact if contact is None else contact, speeds

    def __repr__(self) -> str:
        return short(self)

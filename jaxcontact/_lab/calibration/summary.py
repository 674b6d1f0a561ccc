"""The summary of a calibration: plain data with report, export and file."""

from __future__ import annotations

import dataclasses
import os

import jax
import numpy as np
from jaxtyping import Float

from ..._calibration.choice.selection import kind_of_law, law_in
from ..._contact import Contact
from ..._entry import require_path
from ..._laws import AbstractLaw
from ..._text.files import read_whole, write_all
from .as_json import FormatError, dumps, loads
from .full_report import report
from .short_report import short
from .summary_data import SummaryData

VERSION = 6
"""Version of the file format; raised when a field is added, removed or changes its meaning."""

_SPEEDS = 17
"""Number of closing speeds of an export, over the measured range."""


@dataclasses.dataclass(frozen=True, repr=False)
class CalibrationSummary(SummaryData):
    __doc__ = SummaryData.__doc__

    def table(self) -> str:
        """Return the kinds of laws with their parameters and criteria as text; lower is better."""
        return self.choice.table()

    def report(self) -> str:
        """Return the full report, verdict first.

        It has what `print` shows, then data, marked pairs, fits, their comparison, and open
        questions.
        """
        return report(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the plain data as JSON, completely or not at all; `load_calibration` reads it.

        Raises OSError if writing fails, and ValueError for a number that is not finite.
        """
        write_all({require_path("path", path): self.to_json().encode()})

    def to_json(self) -> str:
        """Return the text that `save` writes."""
        return dumps(self, CalibrationSummary, VERSION)

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


def load_calibration(path: str | os.PathLike[str]) -> CalibrationSummary:
    """Load the calibration that `Calibration.save` wrote, every number to its last bit.

    Returns a `CalibrationSummary` as plain data: `.law`, `.contact`, `.standard_errors`, `.choice`
    and all other results. Raises ValueError, which names file and field, for an unknown format
    version, an unknown or missing field, an unknown law, and a number that is missing or not
    finite. Raises ValueError for an invalid path, and OSError for a file that cannot be read.
    """
    file = require_path("path", path)
    try:
        with jax.enable_x64(True):
            return loads(read_whole(file).decode("utf-8"), CalibrationSummary, VERSION)
    except (FormatError, UnicodeDecodeError) as error:
        raise ValueError(f"{file}: {error}") from error

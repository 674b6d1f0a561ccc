"""The result of `fit`, with the methods that continue from it."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from .data import FitData, why_no_error
from .uncertainty.adequacy import Adequacy, adequacy_of
from .uncertainty.bootstrap import bootstrap
from .uncertainty.interval import confidence_band, interval, prediction_band, profile


@dataclasses.dataclass(frozen=True, repr=False)
class Fit(FitData):
    __doc__ = FitData.__doc__

    bootstrap = bootstrap
    confidence_band = confidence_band
    interval = interval
    prediction_band = prediction_band
    profile = profile

    @functools.cached_property
    def adequacy(self) -> Adequacy:
        """The tests whether the model describes the data, computed on first use."""
        return adequacy_of(self)

    @property
    def adequate(self) -> bool | None:
        """True if the model describes the data; None if undecided."""
        return self.adequacy.adequate

    def summary(self) -> str:
        """Return the fit in words, with a line for each parameter."""
        good = "converged" if self.converged else "NOT CONVERGED"
        points = np.count_nonzero(self.problem.factor)
        lines = [
            f"Fit: {good} in {self.steps} steps, {self.reason}",
            f"  loss {self.loss:.6g}, {points} points, {self.dof} degrees of freedom",
        ]
        if self.converged:
            verdict = str(self.adequacy)
            first = self.adequate is False
            lines.insert(
                0 if first else 2, verdict[0].upper() + verdict[1:] if first else f"  {verdict}"
            )
        width = max(map(len, self.names))
        lines += [
            f"  {name:{width}}  {f'{value:.9g} {unit}'.rstrip()}{self._certainty(name)}"
            for name, value, unit in zip(
                self.names, self.values, self.problem.space.units, strict=True
            )
        ]
        lines += [f"  not identifiable: a change of {d}" for d in self.unidentified]
        lines += [f"  {note}" for note in self.notes]
        return "\n".join(lines)

    def _certainty(self, name: str) -> str:
        if not self.converged:
            return ""
        if name in self.at_bound:
            return "  at its bound"
        error = self.standard_errors[name]
        if not np.isnan(error):
            return f"  ± {error:.2g}" + (", were the model right" if self.adequate is False else "")
        return f"  {why_no_error(self, name)}"

    __repr__ = summary

"""The result of a choice among friction laws."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from ..._entry import require_choice
from ..._fit import Candidate, Fit, table
from ..._friction import AbstractFriction


def said(fit: Fit) -> str:
    """Return the fitted numbers of a friction law with their standard errors, in words."""
    texts = []
    for name, value in zip(fit.names, fit.values, strict=True):
        error = fit.standard_errors[name]
        if name in fit.at_bound:
            texts.append(f"{name} = {value:.3g} (at its bound)")
        elif error > 0:
            texts.append(f"{name} = {value:.4g} ± {error:.2g}")
        else:
            texts.append(f"{name} = {value:.4g} (not identifiable)")
    return ", ".join(texts)


@dataclasses.dataclass(frozen=True, repr=False)
class FrictionChoice:
    """Friction laws fitted to the same oblique impacts: how well each describes them.

    - `candidates`: the comparison in the order of AICc (see `compare_fits`).
    - `best`: the name of the law to use, None if no fit converged; `verdict`: the same in words.
    - `rivals`: the laws that describe the data as well.
    - `fits`: by name, each a `Fit` whose params are the friction law.
    - `next_measurement`: the measurement that would distinguish best and rivals, in words.
    - `left_out`: the laws that do not apply to this contact, and why.
    """

    candidates: tuple[Candidate, ...]
    best: str | None
    verdict: str
    rivals: tuple[str, ...]
    fits: Mapping[str, Fit]
    next_measurement: str
    left_out: Mapping[str, str]

    def friction(self, name: str | None = None) -> AbstractFriction:
        """Return a fitted friction law, by default the best one.

        Raises ValueError for an unknown name, and if its fit did not converge.
        """
        chosen = self.best if name is None else name
        if chosen is None:
            raise ValueError("No fit converged, so there is no best law; see `fits`.")
        found = self.fits[require_choice("name", chosen, self.fits)]
        if not found.converged:
            raise ValueError(f"The fit of {chosen} did not converge: {found.reason}.")
        return found.params

    def table(self) -> str:
        """Return the laws with their parameters and criteria; lower is better."""
        return "\n".join(table(self.candidates, lambda name: said(self.fits[name])))

    @property
    def headline(self) -> str:
        """The best law and its numbers; beside them the range of μ by laws of equal merit."""
        if self.best is None:
            return "No fit converged."
        line = f"{said(self.fits[self.best])} by {self.best}"
        mu = [float(self.friction(name).mu) for name in (self.best, *self.rivals)]
        if self.rivals:
            line += f"; mu = {min(mu):.4g} to {max(mu):.4g} by laws that describe the data as well"
        return line

    def __repr__(self) -> str:
        lines = [self.headline, self.verdict, self.table()]
        if self.best is not None:
            lines += self.fits[self.best].notes
        lines += [f"{name} is left out: {why}" for name, why in self.left_out.items()]
        if self.next_measurement:
            lines.append(self.next_measurement)
        return "\n".join(lines)

"""Results of a choice among the kinds of laws."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from ... import AbstractLaw, Contact, Fit
from ...extend import POSITIVE, Candidate, Comparison, Floats, column, counted, require_choice
from .certainty import Curve, Line
from .equivalent_e import Asked
from .kind import Estimate, Kind, delivered, with_stiffness

_NUMBERS = "number", "numbers"

_CONSTANT = "e", "e delivered"
"""Names of the estimate of a constant e, as in `constant_e`."""


@dataclasses.dataclass(frozen=True)
class LawFit:
    """One kind of law fitted to n pairs, as plain numbers and words.

    `law` is the registered name. `estimates`: what e(v) determines first, then what follows from
    it. `errors_by`: "group" for standard errors by trial, "point" for independent pairs, "readings"
    if the correlation follows from known errors of readings.

    `identifiable`: whether the data determine every parameter; `unidentified`, what e(v) leaves
    open. `rms` is the root mean square of e_measured - e(v). `reduced_chi2` is Σ z²/(n-k) of the
    residuals z of ln e over their noise. `adequate`, whether the law describes the data (None if
    undecided), and its `grounds`, the tests in words. `converged`, the `reason`, and the `steps`
    taken. `determined`: how many of the estimates are parameters. `reduced_to`: the special case of
    this kind whose fit is the same; "" if there is none.
    """

    kind: str
    law: str
    estimates: tuple[Estimate, ...]
    errors_by: str
    identifiable: bool
    unidentified: str
    rms: float
    reduced_chi2: float
    adequate: bool | None
    grounds: str
    converged: bool
    reason: str
    steps: int
    determined: int = dataclasses.field(default=1, kw_only=True)
    reduced_to: str = dataclasses.field(default="", kw_only=True)

    @property
    def constant(self) -> Estimate:
        """The fitted e of the constant-e kind."""
        return next(one for one in reversed(self.estimates) if one.name in _CONSTANT)

    @property
    def said(self) -> str:
        """The parameters that e(v) determines, in words."""
        if self.reduced_to:
            return f"as {self.reduced_to}"
        return ", ".join(f"{e.name} = {e}" for e in self.estimates[: self.determined])


@dataclasses.dataclass(frozen=True)
class ChoiceData:
    """All kinds of laws on the same pairs, as plain data.

    `count` of pairs. `candidates`, the comparison in the order of AICc (see `compare_fits`).
    `best`, the kind to use, None if no fit converged. `sure`, whether the data determine `best`
    with certainty (see `choose_law`), and `verdict`, the same in words.

    `laws`, the fits in the order in which they were made, a constant e first. `line`, the trend
    without a law. `free`, the smooth curve that shows how much better any law could be. `asked`,
    the e to set in each law of constant e to deliver the fitted constant e. `next_measurement`, in
    words, the measurement that would settle an undecided choice. `rivals`, the laws other than the
    best that are not ruled out.
    """

    count: int
    candidates: tuple[Candidate, ...]
    best: str | None
    sure: bool
    verdict: str
    laws: tuple[LawFit, ...]
    line: Line
    free: Curve
    asked: tuple[Asked, ...]
    next_measurement: str
    rivals: tuple[str, ...] = dataclasses.field(default=(), kw_only=True)

    def law_fit(self, kind: str) -> LawFit:
        """Return the fit of a kind of law, by its name; raise ValueError for an unknown one."""
        require_choice("kind", kind, [law.kind for law in self.laws])
        return next(law for law in self.laws if law.kind == kind)

    @property
    def constant(self) -> Estimate:
        """The constant e of the first law, which has constant e."""
        return self.laws[0].constant

    @property
    def yardstick(self) -> str:
        """The gain of any smooth curve of e(v) over the best law, in words.

        It is "" for few points, and if contact times or peak forces were fitted too.
        """
        lowest = min((c.aicc for c in self.candidates if c.converged), default=None)
        if self.free.aicc is None or lowest is None:
            return ""
        gain = lowest - self.free.aicc
        free = f"a free smooth curve of {counted(len(self.free.coefficients), _NUMBERS)}"
        place = f"{abs(gain):.1f} {'below' if gain > 0 else 'above'} the lowest of the laws"
        if self.better_possible:
            return f"{free} has an AICc {place}: a better law is possible"
        return f"no smooth curve is clearly better: {free} has an AICc {place}"

    @property
    def better_possible(self) -> bool:
        """True if a free smooth curve is clearly better than every law."""
        return self.free.better

    def table(self) -> str:
        """Return the kinds of laws with their parameters and criteria; lower is better."""
        same = Comparison(self.candidates, self.best, self.verdict)
        return same.table(lambda kind: self.law_fit(kind).said)


def kind_asked(choice: ChoiceData, laws: str) -> str | None:
    """Return the kind of the law that was asked for; the best one if there was none."""
    return {one.law: one.kind for one in choice.laws}.get(laws, choice.best)


def chosen_fit(
    argument: str, name: str | None, best: str | None, fits: Mapping[str, Fit]
) -> tuple[str, Fit]:
    """Return the name and the fit of a candidate, by default of the `best` one.

    Raises ValueError for an unknown name, and if its fit did not converge.
    """
    chosen = best if name is None else name
    if chosen is None:
        raise ValueError("No fit converged, so there is no best law; see `fits`.")
    found = fits[require_choice(argument, chosen, fits)]
    if not found.converged:
        raise ValueError(f"The fit of {chosen} did not converge: {found.reason}.")
    return chosen, found


@dataclasses.dataclass(frozen=True, repr=False)
class LawChoice(ChoiceData):
    """All kinds of laws on one table of e(v): how well each describes it, and its parameters.

    It has the plain data of the choice (`candidates` in the order of AICc, `best`, `verdict`,
    `laws`, `sure`, `line`, `free`, `asked`, `count`). In addition: `fits` by kind, each a `Fit` of
    ln e over the speed, padded with points without weight; the given `contact`, in whose units they
    are; and `marked` (n,), the points left out as outliers. `reference` in m/s is the speed to
    which the c of a power law, the b of 1 - b v^p and the a of a v^-p belong.
    """

    fits: Mapping[str, Fit]
    _kinds: tuple[Kind, ...]
    contact: Contact
    reference: float
    marked: np.ndarray

    def law(self, kind: str | None = None) -> AbstractLaw:
        """Return the fitted law of a kind, by default of the best one, for its `contact_of`.

        Raises ValueError for an unknown kind, and if its fit did not converge.
        """
        of, found = self._of(kind)
        with jax.enable_x64(True):
            contact = with_stiffness(self.contact, found.params)
            params = of.moved(found.params, self.contact, contact)
            return of.law_of(params, jnp.asarray(self.reference))

    def contact_of(self, kind: str | None = None) -> Contact:
        """Return the contact of a kind, by default of the best one.

        It is the given contact, with the fitted stiffness if contact times or peak forces were
        fitted. Raises ValueError for an unknown kind, and if its fit did not converge.
        """
        with jax.enable_x64(True):
            return with_stiffness(self.contact, self._of(kind)[1].params)

    def _of(self, kind: str | None) -> tuple[Kind, Fit]:
        chosen, found = chosen_fit("kind", kind, self.best, self.fits)
        return next(k for k in self._kinds if k.name == chosen), found

    def curve(self, kind: str, speeds: ArrayLike) -> tuple[Floats, Floats]:
        """Return e of a kind at closing speeds (n,) in m/s, and its standard error.

        Raises ValueError for an unknown kind, and for speeds that are not positive.
        """
        found = self.fits[require_choice("kind", kind, self.fits)]
        return delivered(found, column(speeds, "speeds", POSITIVE))

    def __repr__(self) -> str:
        lines = [self.table(), self.verdict]
        if self.yardstick:
            lines.append(f"{self.yardstick[0].upper()}{self.yardstick[1:]}.")
        marked = int(self.marked.sum())
        if marked:
            lines.append(f"{marked} of {len(self.marked)} points are outliers and are left out.")
        if self.best == self.laws[0].kind:
            e = self.constant.value
            lines.append(f"Parameter e of each law that delivers e = {e:.5f}:")
            lines += [f"  {asked.sentence}" for asked in self.asked]
        if self.next_measurement:
            lines.append(f"{self.next_measurement[0].upper()}{self.next_measurement[1:]}.")
        return "\n".join(lines)

"""Which kind of law describes restitutions measured over the closing speed."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from .._contact import Contact, require_contact
from .._fit import CLEAR_AICC, Candidate, Fit, compared, fit, groups_of, table, undecided
from .._flight import Flight, Floats
from .._laws import AbstractLaw
from .._measurements import (
    MEASURED_RESTITUTION,
    Pairs,
    counted,
    make_pairs,
    read_recording,
)
from .._measurements._noise import Noise, estimate_noise
from .._measurements._outliers import Outliers, find_outliers
from .._parameter import (
    POSITIVE,
    as_weights,
    rendered,
    require_choice,
    require_flag,
)
from ._asked import Asked, asked_of
from ._checks import column, for_each
from ._estimate import Estimate
from ._kinds import (
    AbstractKind,
    LogRestitution,
    delivered,
    is_identifiable,
    kinds_of,
    padded,
)
from ._sure import sure_of, sure_sentence
from ._trend import Curve, Line, curve_of, line_of
from ._undecided import what_settles

_NUMBERS = "number", "numbers"
_BANDS = 4
"""Bands of speed that are left out in turn; each holds at least one pair."""


@dataclasses.dataclass(frozen=True)
class LawFit:
    """One kind of law fitted to n pairs: what the fit found, as plain numbers and words.

    `law` is the registered name. `estimates`: what e(v) determines first, then what follows from
    it. `errors_by`: "group" for standard errors by trial, "point" where pairs count as independent.
    `identifiable`: whether the data determine every parameter; `unidentified`, what e(v) leaves
    open. `rms` is the root mean square of e_measured - e(v), `reduced_chi2` Σ z²/(n-k) of the
    residuals z of ln e over their noise. `adequate`, whether the law describes the data (None where
    that cannot be told), and its `grounds`, the tests in words. `converged`, the `reason`, and the
    `steps` taken.
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

    @property
    def said(self) -> str:
        """What e(v) determines, in words."""
        parameters = [e for e in self.estimates if e.name in ("power", self.estimates[0].name)]
        return ", ".join(f"{e.name} = {e}" for e in parameters)


@dataclasses.dataclass(frozen=True)
class ChoiceData:
    """All kinds of laws on the same pairs, as plain data.

    `count` of pairs; `candidates`, the comparison in the order of AICc (see `compare_fits`);
    `best`, the kind to use, None where no fit converged; `sure`, whether the data leave no doubt of
    it: every law that does not contain it is excluded, no law that contains it is clearly better,
    and it describes the data; `verdict`, the same in words; `laws`, the fits in the order in which
    they were made, a constant e first; `line`, the trend without a law, and `free`, the smooth
    curve that shows how much better any law could be; `asked`, the e to set in each law of constant e so that it delivers the constant e found;
    `next_measurement`, in words, what would settle an undecided choice.
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

    def law_fit(self, kind: str) -> LawFit:
        """The fit of a kind of law, by its name; ValueError for an unknown one."""
        require_choice("kind", kind, [law.kind for law in self.laws])
        return next(law for law in self.laws if law.kind == kind)

    @property
    def yardstick(self) -> str:
        """How much better any smooth curve could be than the best law; nothing with few points."""
        if self.free.aicc is None:
            return ""
        gain = min(c.aicc for c in self.candidates) - self.free.aicc
        free = f"a free smooth curve of {counted(len(self.free.coefficients), _NUMBERS)}"
        if gain > CLEAR_AICC:
            return f"{free} has an AICc {gain:.1f} below the best law: a better law is possible"
        return f"no curve could be clearly better: {free} has an AICc {-gain:+.1f} from the best law"

    def table(self) -> str:
        """The kinds of laws with their parameters and criteria; lower is better."""
        return "\n".join(table(self.candidates, lambda kind: self.law_fit(kind).said))


@dataclasses.dataclass(frozen=True, repr=False)
class LawChoice(ChoiceData):
    """All kinds of laws on one table of e(v): how well each describes it, with which parameters.

    Beside the plain data of the choice (`candidates` in the order of AICc, `best`, `verdict`,
    `laws`, `sure`, `line`, `free`, `asked`, `count`): `fits` by kind, each a `Fit` of ln e over the speed, padded
    with points without weight; the `contact` in whose units they are; `marked` (n,), the points
    left out as outliers; `reference` in m/s, the speed to which the c of a power law belongs.
    """

    fits: Mapping[str, Fit]
    kinds: tuple[AbstractKind, ...]
    contact: Contact
    reference: float
    marked: np.ndarray

    @property
    def data(self) -> ChoiceData:
        """The plain data alone."""
        return ChoiceData(**{f.name: getattr(self, f.name) for f in dataclasses.fields(ChoiceData)})

    def law(self, kind: str | None = None) -> AbstractLaw:
        """The fitted law of a kind, by default of the best one.

        Raises ValueError for an unknown kind, and where its fit did not converge.
        """
        chosen = self.best if kind is None else kind
        if chosen is None:
            raise ValueError("No fit converged, so there is no best law; see `fits`.")
        require_choice("kind", chosen, self.fits)
        found = self.fits[chosen]
        if not found.converged:
            raise ValueError(f"The fit of {chosen} did not converge: {found.reason}.")
        of = next(k for k in self.kinds if k.name == chosen)
        with jax.enable_x64(True):
            return of.law_of(found.params, self.contact, jnp.asarray(self.reference))

    def curve(self, kind: str, speeds: ArrayLike) -> tuple[Floats, Floats]:
        """e of a kind at closing speeds (n,) in m/s, and its standard error.

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
            lines.append(f"{marked} of {len(self.marked)} points are outliers and left out.")
        if self.best == self.laws[0].kind:
            e = self.laws[0].estimates[-1].value
            lines.append(f"Laws that deliver e = {e:.5f}, and the e to set in each:")
            lines += [f"  {asked.sentence}" for asked in self.asked]
        if self.next_measurement:
            lines.append(f"{self.next_measurement[0].upper()}{self.next_measurement[1:]}.")
        return "\n".join(lines)


def choose_law(
    velocity: ArrayLike,
    e: ArrayLike,
    contact: Contact,
    *,
    law: str = "all",
    sigma: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    groups: ArrayLike | None = None,
    mark_outliers: bool = True,
    **how: Any,
) -> LawChoice:
    """Every kind of law fitted to restitutions over the closing speed, and which one to use.

    Laws fall into kinds by e(v): a constant e, which most of them deliver (each for a different
    parameter e); a constant c, with α = c v/K (also Marhefka and Orin's law, with a = c/K); c as a
    power of v; 1 - b v^p; and, for n = 3/2, Kuwabara and Kono's, and Thornton's of elastic-plastic
    spheres. One fit for each kind minimises
    Σ ((ln e_k - ln e(v_k))/σ_k)². It is the calibration that `jaxcontact calibrate` and `calibrate`
    make of the same table.

    Arguments: closing speeds `velocity` in m/s and restitutions `e` in (0, 1.2] (noise may bring a
    measured one above 1), both (points,); the `contact`, whose mass and stiffness are taken as
    known (e(v) determines only c/K and A (K/m)^(2/5)); `law`, "all" or the name of one law, as in
    `calibrate`; `sigma`, standard deviations of e, or `weights`, relative ones; `groups` (points,),
    the trial of each point, by default one for each: with at least 8, standard errors and the
    comparison allow for correlation inside a trial; `mark_outliers`, whether points more than 6
    robust standard deviations off the trend are left out; what else `fit` takes (`optimizer`,
    `starts`, ...), for all of them. The held-out error leaves out four bands of speed in turn;
    `compare_fits(choice.fits, groups=...)` leaves out other groups.

    Returns a `LawChoice`, which prints as a table with a verdict, and which `jc.plot.choice` draws.
    Raises ValueError for columns that do not match or leave their range, fewer than 4 points, and
    what `fit` and `compare_fits` raise. Source: Burnham & Anderson (2002), doi 10.1007/b97636.
    """
    require_contact(contact)
    kinds = kinds_of(law, contact.exponent)
    mark_outliers = require_flag("mark_outliers", mark_outliers)
    if how.get("transforms") is not None:
        raise ValueError(
            "Argument `transforms` must be None: each law has its own, but it is "
            f"{rendered(how['transforms'])}."
        )
    v = column(velocity, "velocity", POSITIVE)
    measured = column(e, "e", MEASURED_RESTITUTION, ("velocity", v))
    pairs = make_pairs(read_recording(velocity=v, restitution=measured), Flight())
    pairs.needs_enough()
    word = "row"
    if groups is not None:
        word = "trial"
        pairs = dataclasses.replace(pairs, cluster=groups_of(groups, len(v)))
    outliers = find_outliers(pairs)
    marked = outliers.flagged & mark_outliers
    relative = weights_of(pairs, outliers, ~marked)[1]
    if sigma is not None:
        how["sigma"] = for_each(sigma, "sigma", len(v)) / measured
    elif weights is not None:
        relative = for_each(as_weights(weights), "weights", len(v), zero=True) * measured**2
    return choose(pairs, ~marked, relative, kinds, contact, group=word, **how)


def weights_of(pairs: Pairs, outliers: Outliers, keep: np.ndarray) -> tuple[Noise, Floats]:
    """The noise of ln e about the trend of the pairs to `keep`, and the weights (n,) of all."""
    good = pairs.where(keep)
    residual = np.log(good.restitution) - outliers.trend(good.velocity)
    noise = estimate_noise(residual, good.reading_factor, robust=False)
    return noise, noise.sigma(pairs.reading_factor) ** -2


def choose(
    pairs: Pairs,
    use: np.ndarray,
    weights: Floats,
    kinds: tuple[AbstractKind, ...],
    contact: Contact,
    *,
    known: frozenset[str] = frozenset({"mass", "stiffness"}),
    group: str = "trial",
    progress: Any = None,
    **how: Any,
) -> LawChoice:
    """The choice among `kinds` on the pairs for which `use` (n,) is true; relative `weights` (n,).

    Each kind has one compiled search: pairs without weight pad the data to a few lengths, and
    everything that leaves pairs out (outliers, bands of speed) changes weights only.
    """
    v = pairs.velocity[use]
    middle = float(np.median(v))
    typical = min(max(float(np.median(pairs.restitution[use])), 0.05), 0.999)
    reference = float(np.exp(np.mean(np.log(v))))
    # AICc is finite for n > k + 2 only.
    kinds = tuple(kind for kind in kinds if len(kind.transforms) + 2 < len(v))
    data = _padded_data(pairs, use, weights, how)
    fits: dict[str, Fit] = {}
    for kind in kinds:
        if progress is not None:
            progress(f"fitting {kind.name}")
        with jax.enable_x64(True):
            model = LogRestitution(kind, contact, jnp.asarray(reference))
        start = kind.start(typical, contact, reference)
        fits[kind.name] = fit(model, start=start, transforms=dict(kind.transforms), **data)
    laws = tuple(_law_fit(k, fits[k.name], pairs, use, contact, known, middle) for k in kinds)
    said = {law.kind: law.said for law in laws}
    bands = _bands(pairs, use, len(data["x"]))
    standing = sure_of(fits, kinds)
    comparison = compared(
        fits,
        bands,
        parameters=said.__getitem__,
        left_out="speeds",
        group=group,
        among=None if standing is None else {standing.kind, *standing.containing},
    )
    found = laws[0].estimates[-1]
    some, x = fits[kinds[0].name], np.asarray(data["x"])
    rivals = [c.name for c in undecided(comparison.candidates) if c.name != comparison.best]
    ends = float(v.min()), float(v.max())
    return LawChoice(
        count=int(use.sum()),
        candidates=comparison.candidates,
        best=comparison.best,
        sure=standing is not None,
        verdict=comparison.verdict
        + sure_sentence(fits, kinds, comparison.best, standing, {comparison.best, *rivals}),
        laws=laws,
        line=line_of(some, x),
        free=curve_of(some, x),
        asked=asked_of(found.value, found.standard_error),
        next_measurement=what_settles(fits, comparison.best, rivals, ends),
        fits=fits,
        kinds=kinds,
        contact=contact,
        reference=reference,
        marked=~use,
    )


def _padded_data(
    pairs: Pairs, use: np.ndarray, weights: Floats, how: dict[str, Any]
) -> dict[str, Any]:
    sigma = how.pop("sigma", None)
    data = {
        "data": padded(np.log(pairs.restitution), 0.0),
        "x": padded(pairs.velocity, float(np.median(pairs.velocity))),
        "groups": padded(pairs.cluster, -1),
    }
    if sigma is not None:
        return data | {"sigma": padded(np.where(use, sigma, np.inf), np.inf)} | how
    return data | {"weights": padded(np.where(use, weights, 0.0), 0.0)} | how


def _bands(pairs: Pairs, use: np.ndarray, length: int) -> np.ndarray:
    """Which of the padded points each band of speed leaves out (bands, length)."""
    place = np.flatnonzero(use)
    order = place[np.argsort(pairs.velocity[use], kind="stable")]
    parts = np.zeros((min(_BANDS, len(place)), length), bool)
    for part, band in zip(parts, np.array_split(order, len(parts)), strict=True):
        part[band] = True
    return parts


def _law_fit(
    kind: AbstractKind,
    found: Fit,
    pairs: Pairs,
    use: np.ndarray,
    contact: Contact,
    known: frozenset[str],
    middle: float,
) -> LawFit:
    measured = pairs.restitution[use]
    at_pairs = measured * np.exp(found.residuals[: len(use)][use])
    return LawFit(
        kind=kind.name,
        law=kind.law,
        estimates=kind.estimates(found, contact, known, middle),
        errors_by="group" if found.by_group else "point",
        identifiable=found.converged and is_identifiable(found),
        unidentified=kind.unidentified,
        rms=float(np.sqrt(np.mean((measured - at_pairs) ** 2))),
        reduced_chi2=2 * found.loss / max(found.dof, 1),
        adequate=found.adequate,
        grounds=found.adequacy.grounds,
        converged=found.converged,
        reason=found.reason,
        steps=found.steps,
    )

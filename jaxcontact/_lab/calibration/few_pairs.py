"""Results from fewer pairs than a law needs: e of each, their mean, and a stiffness if measured."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ..._calibration.choice.choose_law import fit_kind, law_fit, padded_data, reference_of
from ..._calibration.choice.equivalent_e import asked_of, delivered_by_laws
from ..._calibration.choice.kind import AbstractKind
from ..._calibration.choice.law_choice import LawChoice
from ..._calibration.choice.outcomes import Columns
from ..._calibration.choice.trend import Curve, Line, line_of
from ..._calibration.pairs.noise import RELATIVE_FLOOR, Noise
from ..._calibration.pairs.outliers import Outliers, Trend
from ..._calibration.pairs.pairs import LEAST_PAIRS, Pairs
from ..._contact import Contact
from ..._fit import Candidate
from ..._flight import Floats
from ..._text.words import counted

_UNKNOWN = "the error of a single pair is unknown"


def none_marked(pairs: Pairs) -> Outliers:
    """Return outliers with no pair marked: with so few pairs a wrong one cannot be identified."""
    level = float(np.median(np.log(pairs.restitution)))
    nothing = np.zeros(len(pairs))
    noise = Noise(RELATIVE_FLOOR, 0.0)
    return Outliers(nothing > 0, nothing, {}, Trend("constant", level, 0.0), noise)


def known_errors(pairs: Pairs, use: np.ndarray) -> tuple[Floats, Floats] | None:
    """Return inverse variances (n,) of ln e and correlation (n, n) from known errors of readings.

    Returns None if the errors are unknown, or if the pairs in `use` differ by more than their
    errors.
    """
    whole = pairs.covariance
    if whole is None:
        return None
    size = np.sqrt(np.diag(whole))
    own, y = whole[np.ix_(use, use)], np.log(pairs.restitution[use])
    inverse = np.linalg.pinv(own)
    left = y - (inverse @ y).sum() / inverse.sum()
    if left @ inverse @ left > len(y) - 1 + 1e-9:
        return None
    return size**-2, whole / np.outer(size, size)


def only_constant(
    pairs: Pairs,
    use: np.ndarray,
    weights: Floats,
    correlation: Floats | None,
    others: Columns,
    kind: AbstractKind,
    contact: Contact,
    *,
    known: bool,
) -> LawChoice:
    """Fit a constant e, the mean of the few pairs in `use`; with `others`, the stiffness too.

    Arguments as for `choose`. `weights` are inverse variances of ln e; they are relative unless
    `known`.
    """
    v = pairs.velocity[use]
    how = {"groups": None} | ({"sigma": weights**-0.5} if known else {})
    data = padded_data(pairs, use, weights, others, correlation, how)
    found = fit_kind(kind, pairs, use, contact, others, data)
    given = frozenset({"mass", "stiffness"} if others else ())
    law = law_fit(kind, found, pairs, use, contact, given)
    if not known and len(v) == 1:
        lacking = [dataclasses.replace(one, lacking=_UNKNOWN) for one in law.estimates]
        law = dataclasses.replace(law, estimates=tuple(lacking))
    k = len(found.names)
    bic = 2 * found.loss + k * math.log((1 + len(others.values)) * len(v))
    constant = law.estimates[0]
    told = found.adequacy
    count = int(use.sum())
    level = float(np.log(constant.value))
    words = pairs.words
    line = Line(level, 0.0, None) if count == 1 else line_of(found, np.asarray(data["x"]))
    return LawChoice(
        count=count,
        candidates=(
            Candidate(
                *(kind.name, k, found.loss, 2 * found.loss + 2 * k, bic, None, None),
                *(found.converged, told.adequate, told.p),
            ),
        ),
        best=kind.name if found.converged else None,
        sure=False,
        verdict=f"Use {kind.name}: {law.said}. {counted(count, words)} cannot distinguish laws.",
        laws=(law,),
        line=line,
        free=Curve((level,), float(v.min()), float(v.max()), None),
        asked=asked_of(constant.value, constant.standard_error, delivered_by_laws()),
        next_measurement=f"a choice among laws needs at least {LEAST_PAIRS} {words[1]}, over the "
        f"range of speeds in your simulation; {pairs.rule}",
        fits={kind.name: found},
        kinds=(kind,),
        contact=contact,
        reference=reference_of(v),
        marked=~use,
    )

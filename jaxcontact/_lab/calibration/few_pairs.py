"""Results from fewer pairs than a law needs: e of each, their mean, and a stiffness if measured."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ..._calibration.choice.equivalent_e import asked_of, delivered_by_laws
from ..._calibration.choice.kind import AbstractKind
from ..._calibration.choice.law_choice import LawChoice
from ..._calibration.choice.table import ChoiceTable
from ..._calibration.choice.trend import Curve, Line, line_of
from ..._calibration.pairs.outliers import Outliers, Trend
from ..._calibration.pairs.pairs import LEAST_PAIRS, Pairs
from ..._calibration.pairs.reading_noise import RELATIVE_FLOOR, Noise
from ..._fit import Candidate
from ..._text.words import counted

_UNKNOWN = "the error of a single pair is unknown"


def none_marked(pairs: Pairs) -> Outliers:
    """Return outliers with no pair marked: with so few pairs a wrong one cannot be identified."""
    level = float(np.median(np.log(pairs.restitution)))
    nothing = np.zeros(len(pairs))
    noise = Noise(RELATIVE_FLOOR, 0.0)
    return Outliers(nothing > 0, nothing, {}, Trend("constant", level, 0.0), noise)


def with_known_errors(table: ChoiceTable) -> ChoiceTable:
    """Return a table of few pairs with the known errors of their readings, for a mean e.

    The errors stay relative, of independent pairs, if readings have no known errors or the pairs in
    use differ by more than theirs.
    """
    pairs, use, whole = table.pairs, table.use, table.pairs.covariance
    errors = table.errors._replace(correlation=None, absolute=False)
    if whole is not None:
        size = np.sqrt(np.diag(whole))
        own, y = whole[np.ix_(use, use)], np.log(pairs.restitution[use])
        inverse = np.linalg.pinv(own)
        left = y - (inverse @ y).sum() / inverse.sum()
        if left @ inverse @ left <= len(y) - 1 + 1e-9:
            correlation = whole / np.outer(size, size)
            errors = errors._replace(sigma=size, correlation=correlation, absolute=True)
    known = frozenset[str]()
    return dataclasses.replace(table, errors=errors, known=known, options={"groups": None})


def only_constant(table: ChoiceTable, kind: AbstractKind) -> LawChoice:
    """Fit a constant e, the mean of the few pairs of a table; with forces, the stiffness too."""
    pairs, v, known = table.pairs, table.velocity, table.errors.absolute
    found = table.fit(kind)
    law = table.law_fit(kind, found)
    if not known and len(v) == 1:
        lacking = [dataclasses.replace(one, lacking=_UNKNOWN) for one in law.estimates]
        law = dataclasses.replace(law, estimates=tuple(lacking))
    k = len(found.names)
    bic = 2 * found.loss + k * math.log((1 + len(table.errors.others.values)) * len(v))
    constant = law.estimates[0]
    told = found.adequacy
    level = float(np.log(constant.value))
    words = pairs.words
    line = Line(level, 0.0, None) if len(v) == 1 else line_of(found, np.asarray(table.data["x"]))
    return LawChoice(
        count=len(v),
        candidates=(
            Candidate(
                *(kind.name, k, found.loss, 2 * found.loss + 2 * k, bic, None, None),
                *(found.converged, told.adequate, told.p),
            ),
        ),
        best=kind.name if found.converged else None,
        sure=False,
        verdict=f"Use {kind.name}: {law.said}. {counted(len(v), words)} cannot distinguish laws.",
        laws=(law,),
        line=line,
        free=Curve((level,), float(v.min()), float(v.max()), None, better=False),
        asked=asked_of(constant.value, constant.standard_error, delivered_by_laws()),
        next_measurement=f"a choice among laws needs at least {LEAST_PAIRS} {words[1]}, over the "
        f"range of speeds in your simulation; {pairs.rule}",
        fits={kind.name: found},
        _kinds=(kind,),
        contact=table.contact,
        reference=table.reference,
        marked=~table.use,
    )

"""What a single impact says, of which no choice among laws can be made: e, and the stiffness."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np

from .._contact import Contact
from .._fit import Candidate, Positive, fit
from .._flight import Floats
from .._measurements import Pairs
from .._measurements._pairs import LEAST_PAIRS
from ._asked import asked_of, delivered_by_laws
from ._choice import LawChoice
from ._choose import law_fit, padded_data
from ._kinds import AbstractKind
from ._outcomes import Columns, LogOutcomes
from ._trend import Curve, Line


def only_constant(
    pairs: Pairs,
    use: np.ndarray,
    weights: Floats,
    correlation: Floats,
    others: Columns,
    kind: AbstractKind,
    contact: Contact,
) -> LawChoice:
    """The e and the stiffness of the one impact in `use`, whose errors are known.

    Arguments as for `choose`; `weights` are the inverse variances of ln e.
    """
    v, e = pairs.velocity[use], pairs.restitution[use]
    how = {"groups": None, "sigma": weights**-0.5}
    data = padded_data(pairs, use, weights, others, correlation, how)
    reference = float(np.exp(np.mean(np.log(v))))
    typical = min(max(float(np.median(e)), 0.05), 0.999)
    with jax.enable_x64(True):
        model = LogOutcomes(kind, contact, jnp.asarray(reference), tuple(others.values))
    start = kind.start(typical, contact, reference) | {"stiffness": float(contact.stiffness)}
    transforms = {**kind.transforms, "stiffness": Positive()}
    found = fit(model, start=start, transforms=transforms, **data)
    known = frozenset({"mass", "stiffness"})
    law = law_fit(kind, found, pairs, use, contact, known, float(np.median(v)))
    k = len(found.names)
    bic = 2 * found.loss + k * math.log(2 * len(v))
    constant = law.estimates[0]
    told = found.adequacy
    count = int(use.sum())
    level = float(np.log(constant.value))
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
        verdict=f"Use {kind.name}: {law.said}. One impact does not tell laws apart.",
        laws=(law,),
        line=Line(level, 0.0, None),
        free=Curve((level,), float(v.min()), float(v.max()), None),
        asked=asked_of(constant.value, constant.standard_error, delivered_by_laws()),
        next_measurement=f"to tell laws apart, record at least {LEAST_PAIRS} impacts, at speeds "
        "that differ as much as those in your simulation",
        fits={kind.name: found},
        kinds=(kind,),
        contact=contact,
        reference=reference,
        marked=~use,
    )

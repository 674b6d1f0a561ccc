"""The kinds of laws to compare, by the name of a law."""

from __future__ import annotations

import operator

import equinox as eqx
from jaxtyping import Array

from ..._contact import Contact
from ..._entry import did_you_mean, rendered
from ..._laws import AbstractLaw, constant_laws, describe
from .kind import AbstractKind
from .kinds import (
    Adhesive,
    ConstantC,
    ConstantE,
    Dashpot,
    Plastic,
    PowerOfLoss,
    PowerOfRestitution,
    PowerOfSpeed,
    Stepped,
    Viscoelastic,
    ViscousAndPlastic,
    Wet,
)

SPEED_DEPENDENT: tuple[AbstractKind, ...] = (
    *(ConstantC(), PowerOfSpeed(), Viscoelastic(), Plastic()),
    *(ViscousAndPlastic(), Wet(), Adhesive(), PowerOfLoss()),
)

ON_REQUEST: tuple[AbstractKind, ...] = (PowerOfRestitution(), Dashpot(), Stepped())
"""Kinds that are compared only if their law is named.

Few tables of e(v) separate a v^-p from the curve of plastic spheres, which falls as v^(-1/4). If
both were compared, no choice of either would be sure. The curves of dashpots have no formula.
"""


def kinds_of(laws: str, exponent: float | Array) -> tuple[AbstractKind, ...]:
    """Return the kinds to compare: a constant e first, then one or all speed-dependent kinds.

    `laws` "all" compares the exact constant e with all of them, except those on request. The name
    of a speed-dependent law, including those on request, compares it with the exact constant e. The
    name of a law with parameter e makes that law deliver the constant e. Kinds that are unknown for
    the exponent are left out. Raises ValueError for any other name.
    """
    others = tuple(kind for kind in SPEED_DEPENDENT if kind.serves(exponent))
    asked = tuple(kind for kind in ON_REQUEST if kind.serves(exponent))
    by_law = {kind.law: kind for kind in (*others, *asked)}
    choices = ["all", *constant_laws(), *by_law]
    if not isinstance(laws, str) or laws not in choices:
        names = {kind.name: kind.law for kind in by_law.values()}
        of_kind = names.get(laws) if isinstance(laws, str) else None
        meant = f" Did you mean {of_kind!r}?" if of_kind else did_you_mean(laws, choices)
        raise ValueError(
            f"Argument `laws` must be one of {', '.join(choices)}, but is {rendered(laws)}.{meant}"
        )
    if laws == "all":
        return (ConstantE(), *others)
    if laws in by_law:
        return (ConstantE(), by_law[laws])
    name = "constant e" if laws == "exact" else f"constant e ({laws})"
    return (ConstantE(laws, name), *others)


def kind_of_law(law: AbstractLaw) -> AbstractKind:
    """Return the kind with the e(v) of a law."""
    kinds = (*SPEED_DEPENDENT, *ON_REQUEST)
    return next((one for one in kinds if describe(one.law).cls is type(law)), ConstantE())


def law_in(law: AbstractLaw, old: Contact, new: Contact) -> AbstractLaw:
    """Return the law with the same e(v) in another contact."""
    kind = kind_of_law(law)
    params = {name: getattr(law, name) for name in kind.transforms if hasattr(law, name)}
    for name, value in kind.moved(params, old, new).items():
        law = eqx.tree_at(operator.attrgetter(name), law, value)
    return law

"""A law α(e) learned from the restitution it should deliver."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Unpack

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..._contact import Contact, require_contact
from ..._entry import rendered
from ..._fit import Fit, fit
from ..._fit.keywords import FitKeywords, takes
from ..._forms import exact_damping_factor
from ..._impact import AbstractMethod, method_of, restitution
from ..._text.units import Shown
from ..pairs.columns import ASKED_AND_DELIVERED, Column, asked_and_delivered
from .shapes import SHAPES, AbstractShape, Rational

_ROUNDS = 4
"""Linear problems of a rational start. The third is within a tenth of the last at degree 6."""

_LOWEST = 1e-3
"""Lowest restitution that weighs a rational start; lower ones count as this."""

_PLACES = 1000
"""Places where a rational start must have no pole."""


class DeliveredByShape(eqx.Module):
    """e_out(e_in) of the law defined by a shape."""

    contact: Contact | None
    method: AbstractMethod = eqx.field(converter=method_of)
    shown: ClassVar[Mapping[str, Shown]] = ASKED_AND_DELIVERED

    def __call__(self, shape: AbstractShape, asked: Float[Array, " n"]) -> Float[Array, " n"]:
        velocity = None if self.contact is None else jnp.ones(())
        return restitution(shape.law(asked), self.contact, velocity, method=self.method)


@takes(FitKeywords)
def learn_law(
    e_in: ArrayLike,
    e_out: ArrayLike | None = None,
    *,
    shape: str | AbstractShape = "rational",
    contact: Contact | None = None,
    method: str | AbstractMethod = "auto",
    **how: Unpack[FitKeywords],
) -> Fit:
    """Learn a law α(e) = g(e) (1-e)/e that delivers e_out for the parameter e_in.

    Arguments: `e_in` in (0, 1] and `e_out` in (0, 1.2] (noise may raise a measured one above 1),
    both (points,); `e_out` is `e_in` by default. `shape` of g: "rational", "spline", "network", or
    your own shape as the start. A rational one starts from a linear fit if that is nearer.
    `contact`, if the method needs one. `method` as in `impact`. Other keywords go to `fit`.

    Returns a `Fit` whose params are the shape: `found.params.law(e=0.4)` is a law like any other.
    Its single numbers have no meaning, and many of them may be undetermined. Raises ValueError for
    columns that do not match or are out of range.
    """
    asked, wanted = asked_and_delivered(e_in, e_out)
    if contact is not None:
        require_contact(contact)
    if not isinstance(shape, AbstractShape):
        if not isinstance(shape, str) or shape not in SHAPES:
            raise ValueError(
                f"Argument `shape` must be one of {', '.join(map(repr, SHAPES))} or a shape, but "
                f"is {rendered(shape)}."
            )
        shape = SHAPES[shape](float(asked.min()))
    if isinstance(shape, Rational):
        shape = _rational_start(shape, asked, wanted)
    return fit(DeliveredByShape(contact, method), wanted, shape, x=asked, **how)


def _rational_start(shape: Rational, asked: Column, wanted: Column) -> Rational:
    """Return the start nearest to what is wanted: by rounds of linear least squares, or `shape`.

    A round fits p - g q with weights w/q of the q before; g delivers `wanted`, and w is the slope
    of e by g there. The rounds end at a pole. A search from a distant start may instead end where a
    pole and a zero cancel. Source: Sanathanan & Koerner (1963), doi 10.1109/TAC.1963.1105517.
    """
    asked, wanted = np.clip([asked, wanted], _LOWEST, 1)[:, asked < 1]  # at 1 any g delivers 1
    e, m = jnp.asarray(wanted), shape.above.size
    alpha, slope = jax.jvp(exact_damping_factor, (e,), (jnp.ones_like(e),))
    ratio = (1 - asked) / asked
    g, weight = np.asarray(alpha, float) / ratio, ratio / np.abs(np.asarray(slope, float))
    basis, grid = (
        np.polynomial.chebyshev.chebvander(t, m - 1)
        for t in (2 * asked - 1, np.linspace(-1, 1, _PLACES))
    )
    columns = np.hstack([basis, -g[:, None] * basis[:, 1:]])
    best = found = np.concatenate([shape.above, shape.below]).astype(float)
    least = np.inf
    for _ in range(_ROUNDS + 1):
        if not (1 + grid[:, 1:] @ found[m:] > 0).all():
            break
        scale = weight / (1 + basis[:, 1:] @ found[m:])
        off = np.sum(np.square(scale * (columns @ found - g)))
        if off < least:
            best, least = found, off
        found = np.linalg.lstsq(scale[:, None] * columns, scale * g)[0]
    values = [jnp.asarray(part, shape.above.dtype) for part in np.split(best, [m])]
    return eqx.tree_at(lambda at: [at.above, at.below], shape, values)

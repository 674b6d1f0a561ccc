"""A law α(e) learned from the restitution it should deliver."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Unpack

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from ..._contact import Contact, require_contact
from ..._fit import Fit, fit
from ..._fit.keywords import FitKeywords, takes
from ..._impact import AbstractMethod, method_of, restitution
from ..._parameter import rendered
from ..._text.units import Shown
from ..pairs.columns import ASKED_AND_DELIVERED, asked_and_delivered
from .shapes import SHAPES, AbstractShape


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
    form: str | AbstractShape = "rational",
    contact: Contact | None = None,
    method: str | AbstractMethod = "auto",
    **how: Unpack[FitKeywords],
) -> Fit:
    """Learn a law α(e) = g(e) (1-e)/e that delivers e_out for the parameter e_in.

    Arguments: `e_in` in (0, 1] and `e_out` in (0, 1.2] (noise may raise a measured one above 1),
    both (points,); `e_out` is `e_in` by default. `form` of g: "rational", "spline", "network", or
    your own shape as the start. `contact`, if the method needs one. `method` as in `impact`. Other
    keywords go to `fit`.

    Returns a `Fit` whose params are the shape: `found.params.law(e=0.4)` is a law like any other.
    Its single numbers have no meaning, and many of them may be undetermined. Raises ValueError for
    columns that do not match or are out of range.
    """
    asked, wanted = asked_and_delivered(e_in, e_out)
    if contact is not None:
        require_contact(contact)
    if not isinstance(form, AbstractShape):
        if not isinstance(form, str) or form not in SHAPES:
            raise ValueError(
                f"Argument `form` must be one of {', '.join(map(repr, SHAPES))} or a shape, but is "
                f"{rendered(form)}."
            )
        form = SHAPES[form](float(asked.min()))
    return fit(DeliveredByShape(contact, method), wanted, form, x=asked, **how)

"""Contact times and peak forces beside e in the choice of a law."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ... import Contact
from ...extend import POSITIVE, Column, Shown, column, for_each, rendered
from ..pairs.pairs import RELATIVE_FLOOR
from .kind import AbstractKind, Params

_TREND = 2
"""Degree of the trend of ln(contact time) or ln(force) over ln v, for the scatter."""


class Columns(NamedTuple):
    """Logarithms of what was measured beside e, by name, and their standard deviations.

    A missing reading has an infinite standard deviation.
    """

    values: dict[str, Column]
    sigma: dict[str, Column]

    def __bool__(self) -> bool:
        return bool(self.values)


NONE = Columns({}, {})


def columns_of(
    given: dict[str, tuple[ArrayLike | None, ArrayLike | None]],
    beside: tuple[str, Column],
    sigma: ArrayLike | None,
    weights: ArrayLike | None,
) -> Columns:
    """Return the given columns, with given or estimated relative standard deviations.

    Without `sigma` the scatter is that about a smooth trend, as for e. Raises ValueError for
    columns that do not match or are out of range, and for standard deviations of only some of them.
    """
    values, sizes = {}, {}
    for name, (measured, error) in given.items():
        if measured is None:
            if error is not None:
                raise ValueError(
                    f"Argument `sigma_{name}` must be None without `{name}`, but is "
                    f"{rendered(error)}."
                )
            continue
        if weights is not None:
            raise ValueError(
                f"Argument `weights` must be None with `{name}`, whose noise is another, but is "
                f"{rendered(weights)}; give `sigma` and `sigma_{name}`, or neither."
            )
        if (error is None) != (sigma is None):
            missing = f"sigma_{name}" if error is None else "sigma"
            raise ValueError(
                f"Arguments `sigma` and `sigma_{name}` must be given both or neither, but "
                f"`{missing}` is None."
            )
        readings = np.log(column(measured, name, POSITIVE, beside, gaps=True))
        there = np.isfinite(readings)
        if error is None:
            size = np.full(len(readings), _scatter(readings[there], beside[1][there]))
        else:
            size = for_each(error, f"sigma_{name}", len(readings))
        values[name] = np.where(there, readings, 0.0)
        sizes[name] = np.where(there, size, np.inf)
    return Columns(values, sizes)


def _scatter(readings: Column, velocity: Column) -> float:
    """Return the standard deviation of readings about a polynomial of ln v."""
    degree = min(_TREND, len(np.unique(velocity)) - 1, len(readings) - 2)
    if degree < 0:
        return 1.0
    trend = np.polynomial.Polynomial.fit(np.log(velocity), readings, degree)
    left = readings - trend(np.log(velocity))
    return max(float(np.sqrt(left @ left / (len(left) - degree - 1))), RELATIVE_FLOOR)


class LogOutcomes(eqx.Module):
    """ln e(v) of a kind of law, and the logarithms of the other `fields`.

    These are contact time in s and largest force in N. The stiffness is a parameter in addition to
    those of the law.
    """

    kind: AbstractKind = eqx.field(static=True)
    contact: Contact
    reference: Float[Array, ""]
    fields: tuple[str, ...] = eqx.field(static=True)

    @property
    def shown(self) -> dict[str, Shown]:
        """The presentation of the columns, which are numbered."""
        columns = enumerate(("restitution", *self.fields))
        return {"x": Shown("velocity")} | {
            str(k): Shown(name, logarithm=True) for k, name in columns
        }

    def __call__(self, params: Params, velocity: Float[Array, " n"]) -> tuple[Array, ...]:
        e = self.kind.restitution(params, self.contact, self.reference, velocity)
        contact = with_stiffness(self.contact, params)
        law = self.kind.law_of(self.kind.moved(params, self.contact, contact), self.reference)
        hit = self.kind.outcome(law, contact, velocity)
        return jnp.log(e), *(jnp.log(getattr(hit, name)) for name in self.fields)


def with_stiffness(contact: Contact, params: Params) -> Contact:
    """Return the contact with the fitted stiffness, if it was fitted."""
    stiffness = params.get("stiffness", contact.stiffness)
    return Contact(contact.mass, stiffness, contact.exponent)

"""A law α(e) learned from the restitution it should deliver."""

from __future__ import annotations

import abc
from collections.abc import Callable, Mapping
from typing import ClassVar, Unpack

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._contact import Contact, require_contact
from .._entry import RESTITUTION, Range, as_parameter, refusal, require_count, require_number
from .._fit import Fit, fit
from .._fit.fit import FitKeywords, takes
from .._forms import exact_damping_factor
from .._functions import chebyshev
from .._impact import AbstractMethod, method_of, restitution
from .._laws import Damped
from .._text.units import Shown
from .columns import ASKED_AND_DELIVERED, Column, asked_and_delivered

_ROUNDS = 4
"""Linear problems of a rational start. The third is within a tenth of the last at degree 6."""

_LOWEST = 1e-3
"""Lowest restitution that weighs a rational start; lower ones count as this."""

_PLACES = 1000
"""Places where a rational start must have no pole."""

_SHORTEST_SPLINE = 4
_BELOW_ONE = Range(low=0.0, high=1.0, high_open=True, inside=0.5)


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
            raise refusal("shape", f"be one of {', '.join(map(repr, SHAPES))} or a shape", shape)
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
    m, (e, one) = shape.above.size, jax.device_put((wanted, np.ones_like(wanted)))
    alpha, slope = jax.jvp(exact_damping_factor, (e,), (one,))
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


class AbstractShape(eqx.Module):
    """A function g(e) > 0 that defines a law α = g(e) (1-e)/e; its arrays are its parameters.

    For the law that delivers exactly the requested e, g rises from 1 at e → 0 to 3/2 at e → 1.
    """

    @abc.abstractmethod
    def __call__(self, e: Float[Array, "..."]) -> Float[Array, "..."]:
        """Return g at e, of any shape."""

    def law(self, e: ArrayLike) -> Damped:
        """Return the law for e in (0, 1], with the damping factor α = g(e) (1-e)/e.

        Raises ValueError for a Python scalar out of range.
        """
        asked = as_parameter(e, "e", RESTITUTION)
        return Damped(alpha=_factor(self, asked))


_factor = eqx.filter_jit(lambda g, e: g(e) * (1 - e) / e, inline=True)  # pyright: ignore


class Rational(AbstractShape):
    """g(e) = Σ a_k T_k(t) / (1 + Σ b_k T_k(t)), t = 2e - 1: Chebyshev polynomials, one degree.

    `degree` is that of both. The start is linear in e: g = 1.25 + 0.25 t.
    """

    above: Float[Array, " degree_plus_1"]
    below: Float[Array, " degree"]

    def __init__(self, degree: int = 6):
        degree = require_count("degree", degree, 1)
        self.above = jax.device_put(np.concatenate([[1.25, 0.25], np.zeros(degree - 1)]))
        self.below = jax.device_put(np.zeros(degree))

    def __call__(self, e: Float[Array, "..."]) -> Float[Array, "..."]:
        t = 2 * e - 1
        below = jnp.concatenate([jnp.ones_like(self.below[:1]), self.below])
        return chebyshev(self.above, t) / chebyshev(below, t)


class Spline(AbstractShape):
    """g(e): a cubic spline with `intervals` equal intervals on [low, 1], from its B-spline weights.

    Outside, the polynomial of the last interval continues. Source: de Boor (1978), doi
    10.1007/978-1-4612-6333-3.
    """

    weights: Float[Array, " intervals_plus_3"]
    low: float = eqx.field(static=True)

    def __init__(self, intervals: int = 80, low: float = 0.0):
        intervals = require_count("intervals", intervals, _SHORTEST_SPLINE)
        self.weights = jax.device_put(np.full(intervals + 3, 1.25))
        self.low = require_number("low", low, _BELOW_ONE)

    def __call__(self, e: Float[Array, "..."]) -> Float[Array, "..."]:
        intervals = self.weights.size - 3
        place = (e - self.low) / (1 - self.low) * intervals
        first = jnp.clip(jnp.floor(jax.lax.stop_gradient(place)), 0, intervals - 1)
        t = place - first
        base = first.astype(int)
        middle = 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1
        cubic = ((1 - t) ** 3, *middle, t**3)
        return sum(w * self.weights[base + k] for k, w in enumerate(cubic)) / 6  # pyright: ignore


class Network(AbstractShape):
    """g(e) = 1.25 + a small network of e: two hidden layers of `width` tanh.

    The same `seed` gives the same start.
    """

    network: eqx.nn.MLP

    def __init__(self, width: int = 8, seed: int = 0):
        width, seed = require_count("width", width, 1), require_count("seed", seed, 0)
        made = eqx.filter_jit(eqx.nn.MLP)
        self.network = made("scalar", "scalar", width, 2, jax.nn.tanh, key=jax.random.key(seed))

    def __call__(self, e: Float[Array, "..."]) -> Float[Array, "..."]:
        flat = jax.vmap(lambda e: self.network(2 * e - 1))(jnp.ravel(e))
        return 1.25 + flat.reshape(jnp.shape(e))


SHAPES: dict[str, Callable[[float], AbstractShape]] = {
    "rational": lambda low: Rational(),
    "spline": lambda low: Spline(low=low),
    "network": lambda low: Network(),
}
"""Initial shapes by name, for restitutions of at least `low`."""

"""The curves e(v) that a calibration fits: a law, and the one number of it that e(v) can fix."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._contact import Contact
from .._impact import restitution
from .._laws import ConstantDamping, Damped, constant_laws, get_law
from ._viscous import viscous_restitution

Kind = Literal["constant", "kuwabara_kono", "constant_damping"]

SPEED_DEPENDENT: tuple[Kind, ...] = ("kuwabara_kono", "constant_damping")


@dataclasses.dataclass(frozen=True)
class Curve:
    """e(v; θ) of one law with one unconstrained number θ.

    `law` is the registered name. `kind` says what θ is: for a constant e, logit of the law's own
    e; for Kuwabara-Kono, ln κ with κ = A (K/m)^(2/5) in (m/s)^(-1/5); for constant damping, ln b
    with b = c/K in s/m. No other combination of the law's and the contact's numbers enters e(v), so
    a contact of unit mass and stiffness serves.
    """

    law: str
    kind: Kind

    @property
    def label(self) -> str:
        """The curve in a few words."""
        return {
            "constant": f"constant e ({self.law})",
            "kuwabara_kono": "Kuwabara-Kono",
            "constant_damping": "constant damping c",
        }[self.kind]

    @property
    def symbol(self) -> str:
        """The name of the fitted number."""
        return {"constant": "e", "kuwabara_kono": "A (K/m)^(2/5)", "constant_damping": "c/K"}[
            self.kind
        ]

    @property
    def unit(self) -> str:
        """The unit of the fitted number."""
        return {"constant": "", "kuwabara_kono": "(m/s)^(-1/5)", "constant_damping": "s/m"}[
            self.kind
        ]

    @property
    def unidentified(self) -> str:
        """What e(v) alone cannot say about this law."""
        return {
            "constant": "mass, stiffness and exponent: e does not depend on them",
            "kuwabara_kono": "A, K and m one by one: e(v) fixes only A (K/m)^(2/5)",
            "constant_damping": "c and K one by one: e(v) fixes only c/K, and says nothing of m",
        }[self.kind]

    def start(self, restitution: float, velocity: float) -> Array:
        """A θ (1,) whose curve passes near e = `restitution` at `velocity` m/s."""
        e = min(max(restitution, 0.05), 0.999)
        if self.kind == "constant":
            return jnp.array([math.log(e / (1 - e))])
        if self.kind == "kuwabara_kono":
            # 1 - e ≈ 1.15344 (3/2) κ v^(1/5) while that is small, too much where it is not.
            return jnp.array([math.log(min((1 - e) / 1.73, 0.4) / velocity**0.2)])
        # α = b v, and α = 3(1-e)/(2e) is nearly what delivers e (Hu and Guo).
        return jnp.array([math.log(1.5 * (1 - e) / (e * velocity))])

    def value(self, theta: Float[Array, "1"]) -> Float[Array, ""]:
        """The fitted number, in `unit`."""
        return jax.nn.sigmoid(theta[0]) if self.kind == "constant" else jnp.exp(theta[0])

    def restitution(
        self, theta: Float[Array, "1"], velocity: Float[Array, "..."]
    ) -> Float[Array, "..."]:
        """e at approach speeds `velocity` in m/s; differentiable in both modes."""
        value = self.value(theta)
        # Without contact and speed `restitution` takes the closed form at once, and compiles in
        # half the time.
        if self.kind == "constant":
            return jnp.broadcast_to(restitution(get_law(self.law, e=value)), jnp.shape(velocity))
        if self.kind == "constant_damping":
            alpha = ConstantDamping(c=value).damping_factor(Contact(1.0, 1.0, 1.5), velocity)
            return restitution(Damped(alpha=alpha))
        # The law's limit of s is a guard against wild steps of the line search; a fit that ends
        # there is reported as not determined.
        return viscous_restitution(value * velocity**0.2)


def choose_curves(law: str | None) -> tuple[Curve, ...]:
    """The curves to compare: a constant one first, then one or all speed-dependent ones.

    `law` None or "all" compares the exact constant e with both speed-dependent laws; the name of
    one of these compares it with the exact constant e; the name of a law with parameter e makes
    that the constant one. Raises ValueError for any other name.
    """
    if law is None or law == "all":
        return (Curve("exact", "constant"), *(Curve(k, k) for k in SPEED_DEPENDENT))
    for kind in SPEED_DEPENDENT:
        if law == kind:
            return (Curve("exact", "constant"), Curve(kind, kind))
    if law not in constant_laws():
        choices = ", ".join(["all", *constant_laws(), *SPEED_DEPENDENT])
        raise ValueError(f"Argument `law` must be one of {choices}, but is {law!r}.")
    return (Curve(law, "constant"), *(Curve(k, k) for k in SPEED_DEPENDENT))


@functools.partial(jax.jit, static_argnames="curve")
def evaluate(
    curve: Curve, theta: Float[Array, "1"], velocity: Float[Array, " n"]
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """e (n,) and de/dθ (n,) at speeds (n,)."""
    return jax.jvp(lambda t: curve.restitution(t, velocity), (theta,), (jnp.ones_like(theta),))


@dataclasses.dataclass(frozen=True)
class Misfit:
    """Half the mean square of (ln e_measured - ln e(v; θ))/σ; hashable, one per curve.

    Measurements with infinite σ do not count.
    """

    curve: Curve

    def __call__(
        self,
        theta: Float[Array, "1"],
        velocity: Float[Array, " n"],
        log_restitution: Float[Array, " n"],
        sigma: Float[Array, " n"],
    ) -> Float[Array, ""]:
        """The loss at θ (1,) for measurements (n,)."""
        model = jnp.log(self.curve.restitution(theta, velocity))
        square = jnp.square((log_restitution - model) / sigma)
        return jnp.mean(square, where=jnp.isfinite(sigma)) / 2

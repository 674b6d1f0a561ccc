"""One tangential spring and slider, as discrete element codes have it, the scaled numbers of laws
with such a spring, and friction by small steps of time.

The steps have trial forces that the slider's limit cuts. They are implicit in the slip, which makes
them of second order; explicit ones, as codes have them, are of first order. They serve
trajectories. Outcomes are solved by phases and tables.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, cast

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._entry import (
    NOT_NEGATIVE,
    POSITIVE,
    optional_parameter,
    parameter,
    refuses_unknown,
    require_choice,
    static_value,
)
from .base import (
    AbstractFriction,
    Exponent,
    Lane,
    NormalPath,
    ScaledSpring,
    Tangential,
    TangentialOutcome,
    own_ratio,
)
from .phases import slider_phases
from .sticking import FORMS


def ratio_of(law: AbstractFriction, of_contact: Lane | None) -> Lane:
    """Return κ of the law, or that of the contact. Raises ValueError if both are None."""
    own = own_ratio(law)
    kappa = of_contact if own is None else own
    if kappa is None:
        raise ValueError(
            f"Argument `ratio` of `{type(law).__name__}` must be given, or the contact be built "
            "from materials (`Contact.sphere_plane`), but both are None."
        )
    return kappa


def spring_of(law: AbstractFriction, problem: Tangential) -> ScaledSpring:
    """Return the scaled numbers. Raises ValueError without a stiffness ratio."""
    kappa = ratio_of(law, problem.ratio)
    free = law.mu <= 0
    mu = jnp.where(free, 1, law.mu)
    psi = jnp.where(free, 0, kappa * problem.slip / mu)
    return ScaledSpring(psi, problem.mobility * kappa / 2, mu / kappa, free, problem.slip)


def hertzian(problem: Tangential) -> bool:
    """Return whether the normal force is x^(3/2) (1 + αx')."""
    return problem.alpha is not None and static_value(problem.exponent) == 1.5


_SPRINGS = 128
"""Springs of a row. The error of the slip falls with the square of their number."""

_ITERATIONS = 3


def slider_along(
    spring: ScaledSpring, n: Exponent, form: str, path: NormalPath
) -> tuple[Lane, Lane]:
    """Return the slip, and the friction over μ, of one spring and slider along a normal motion."""
    depth = jnp.maximum(path.indentation, 0)
    stiffness = n * depth ** (n - 1)
    # The stiffness at the turn, from which on a "rescaled" force keeps its displacement.
    falls = jnp.where(path.velocity < 0, 1, 0).astype(depth.dtype)
    scales = {"force": jnp.zeros_like(falls), "displacement": jnp.ones_like(falls)}
    scales = scales.get(form, falls)
    before = jnp.concatenate([stiffness[:1], stiffness[:-1]])
    kept = jnp.where(before > 0, stiffness / jnp.where(before > 0, before, 1), 1)
    rows = (
        jnp.where(scales > 0, kept, 1),
        jnp.where(scales > 0, stiffness, (before + stiffness) / 2),
        path.force,
    )

    def forces(held: Lane, moved: Lane, row: Any) -> tuple[Lane, Lane]:
        keeps, grows, most = row
        phi = jnp.clip(keeps * held + grows * moved, -most, most)
        return phi, phi

    return _along(spring, path, jnp.zeros_like(path.force[0]), rows, forces)


def springs_along(spring: ScaledSpring, path: NormalPath) -> tuple[Lane, Lane]:
    """Return the slip, and the friction over μ, of a row of springs, each with a limit.

    The spring at q touches at x = q² and has the limit x - q² in a Hertz contact, times (1 + αx')
    with damping. Source: Popov & Heß (2015), doi 10.1007/978-3-642-53876-6.
    """
    depth = jnp.maximum(path.indentation, 0)
    width = jnp.sqrt(jnp.max(depth, axis=0))
    spots = (jnp.arange(_SPRINGS, dtype=depth.dtype) + 0.5) / _SPRINGS
    squares = jnp.square(spots.reshape((-1,) + (1,) * width.ndim) * width[None])
    hertz = depth * jnp.sqrt(depth)
    damped = jnp.where(hertz > 0, path.force / jnp.where(hertz > 0, hertz, 1), 0)

    def forces(held: Lane, moved: Lane, row: Any) -> tuple[Lane, Lane]:
        deep, grown, factor = (number[None] for number in row)
        most = jnp.maximum(deep - squares, 0) * factor
        # A spring that touches within the step moves only in the rest of it.
        within = jnp.where(grown > 0, (deep - squares) / jnp.where(grown > 0, grown, 1), 1)
        taus = jnp.clip(held + jnp.clip(within, 0, 1) * moved[None], -most, most)
        # A spring out of contact has no force, so that it starts anew.
        return taus, 1.5 * width / _SPRINGS * jnp.sum(taus, axis=0)

    grown = depth - jnp.concatenate([depth[:1], depth[:-1]])
    start = jnp.zeros_like(squares)
    return _along(spring, path, start, (depth, grown, damped), forces)


def _along(
    spring: ScaledSpring,
    path: NormalPath,
    start: Lane,
    rows: Any,
    forces: Callable[[Lane, Lane, Any], tuple[Lane, Lane]],
) -> tuple[Lane, Lane]:
    step = path.time[1] - path.time[0]

    def advance(carry: tuple[Lane, Lane, Lane], row: Any) -> Any:
        psi, held, phi = carry

        def improved(_: Any, now: tuple[Lane, Lane, Lane]) -> tuple[Lane, Lane, Lane]:
            after, *_ = now
            springs, force = forces(held, step * (psi + after) / 2, row)
            return psi - spring.chi[0] * step * (phi + force), springs, force

        now = jax.lax.fori_loop(0, _ITERATIONS, improved, (psi, held, phi))
        return now, (now[0], now[2])

    psi = jnp.broadcast_to(spring.psi[0], path.force[0].shape)
    first = (psi, start, jnp.zeros_like(psi))
    later = jax.tree.map(lambda leaf: leaf[1:], rows)
    slips, frictions = jax.lax.scan(advance, first, later)[1]
    slips = jnp.concatenate([psi[None], slips])
    frictions = jnp.concatenate([jnp.zeros_like(psi)[None], frictions])
    return spring.slip(slips), frictions


class SpringSlider(AbstractFriction):
    """One tangential spring and slider at each contact: f' = κ n K δ^(n-1) u in stick, |f| ≤ μ F.

    - `mu`: the coefficient μ ≥ 0.
    - `ratio`: κ > 0, the tangential stiffness over the normal one; None for that of the contact's
      materials, `4G*/E*`.
    - `form`: "force" adds up increments of the force (LAMMPS `mindlin/force`); "displacement" has f
      = κ n K δ^(n-1) ξ, ξ' = u (`mindlin`); "rescaled" is the first while loading and the second
      while unloading (`mindlin_rescale/force`).

    At small angles "force" and "displacement" may create energy; "rescaled" does not. Raises
    ValueError for a Python scalar out of range. Source: Mindlin & Deresiewicz (1953), doi
    10.1115/1.4010702, as simplified in codes; Thornton et al. (2011), doi
    10.1016/j.powtec.2011.01.013.
    """

    kind = "spring"
    substeps = 16
    mu: Float[Array, "..."] = parameter("mu", NOT_NEGATIVE)
    ratio: Float[Array, "..."] | None = optional_parameter("ratio", POSITIVE, "-")
    form: Literal["force", "displacement", "rescaled"] = eqx.field(static=True, default="force")

    @refuses_unknown
    def __init__(
        self,
        mu: ArrayLike,
        ratio: ArrayLike | None = None,
        form: Literal["force", "displacement", "rescaled"] = "force",
    ):
        self.mu, self.ratio = cast(Any, (mu, ratio))  # the fields have converters
        require_choice("form", form, FORMS)
        self.form = form

    def has_formula(self, problem: Tangential) -> bool:
        return hertzian(problem)

    @property
    def held(self) -> str:
        return self.form

    @property
    def is_followed(self) -> bool:
        return self.form == "force"

    def require_for_system(self) -> None:
        if self.form != "force":
            raise ValueError(
                'Argument `form` of the `SpringSlider` of a `System` must be "force", but is '
                f'"{self.form}".'
            )

    def along(self, problem: Tangential, path: NormalPath) -> tuple[Lane, Lane]:
        slip, force = slider_along(spring_of(self, problem), problem.exponent, self.form, path)
        return slip, self.mu * force

    def rebound(self, problem: Tangential) -> TangentialOutcome:
        scaled = spring_of(self, problem)
        assert problem.alpha is not None
        found = slider_phases(scaled.psi, scaled.chi, problem.alpha, self.form)
        slid, e = scaled.free | (found.stop <= -problem.restitution), problem.restitution
        return TangentialOutcome(
            slip=scaled.slip(found.psi2),
            slid=slid,
            stop=jnp.where(slid, -e, found.stop),
            start=jnp.where(slid, -e, found.slip),
            converged=found.converged,
        )

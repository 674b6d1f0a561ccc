"""The restitution of an engine whose steps are not short compared with the contact."""

from __future__ import annotations

import dataclasses
import enum
import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .. import AbstractLaw, Contact

_PHASES = 256
"""Examined positions within a step at which a ball may touch."""

_LONGEST = 64
"""Contact durations after which a ball that has not left counts as resting."""

_FEWEST, _MOST, _HALVINGS = 2.0, 2.0**14, 8
"""Range of steps per contact that is searched, and the number of halvings."""

_NEWTON = 30
"""Halvings of the velocity after an implicit step: to 1e-9 of its change."""


class Scheme(enum.Enum):
    """Time stepping of a contact; forces act if the bodies overlap at the start of a step."""

    SEMI_IMPLICIT = "v' = v - h F(δ, v)/m, δ' = δ + h v'"
    """Force of the state before the step: semi-implicit Euler, or leapfrog with v half a step
    behind.
    """
    IMPLICIT = "v' = v - h F(δ + h v', v')/m, δ' = δ + h v'"
    """Force of the state after the step, of first order: implicit Euler."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TimeStepRestitution:
    """The restitution of an engine at a time step.

    `time_step` in s; `low` and `high` are the smallest and the largest e over all positions of the
    touch within a step; `target` is the wanted e; `duration` in s of the contact. A softer contact
    of at least `needed` s keeps e `within` the target at this step. `needed` is NaN if none of up
    to 16384 steps per contact suffices. Gravity is not included.
    """

    time_step: float
    low: float
    high: float
    target: float
    duration: float
    within: float
    needed: float

    def __str__(self) -> str:
        spread = f"e from {self.low:.3f} to {self.high:.3f}, by where in a step the ball touches"
        lines = [
            f"at steps of {self.time_step:.3g} s, {self.duration / self.time_step:.3g} in a contact"
            f" of {self.duration:.3g} s: {spread}"
        ]
        if self.needed <= self.duration:
            lines.append(f"that is within {self.within:g} of the target {self.target:.4g}")
        elif math.isfinite(self.needed):
            lines.append(
                f"within {self.within:g} of the target {self.target:.4g} from a contact of "
                f"{self.needed:.3g} s on, or at steps of "
                f"{self.time_step * self.duration / self.needed:.3g} s"
            )
        else:
            lines.append(f"no step keeps e within {self.within:g} of the target {self.target:.4g}")
        return "\n".join(lines)


def restitution_in_steps(
    law: AbstractLaw,
    contact: Contact,
    velocity: float,
    *,
    target: float,
    duration: float,
    scheme: Scheme,
    time_step: float,
    within: float,
) -> TimeStepRestitution:
    """Compute the e of a law in the steps of an engine, and the contact duration that preserves it.

    A softer contact with the same law, in its own units, has proportionally shorter steps. e
    therefore depends on the number of steps per contact only.
    """
    with jax.enable_x64(True):
        phases = jnp.linspace(1 / _PHASES, 1.0, _PHASES)

        def ends(count: float) -> tuple[float, float]:
            step = jnp.asarray(duration / count)  # a number would be static
            e = _rebounds(law, contact, jnp.asarray(velocity), step, phases, scheme)
            return float(jnp.min(e)), float(jnp.max(e))

        def keeps(count: float) -> bool:
            low, high = ends(count)
            return max(target - low, high - target) <= within

        low, high = ends(duration / time_step)
        count = _FEWEST
        while count < _MOST and not (keeps(count) and keeps(1.3 * count)):
            count *= 2
        bad, enough = count / 2, count
        for _ in range(_HALVINGS if count < _MOST else 0):
            middle = math.sqrt(bad * enough)
            bad, enough = (bad, middle) if keeps(middle) else (middle, enough)
    needed = enough * time_step if count < _MOST else math.nan
    return TimeStepRestitution(
        time_step=time_step,
        low=low,
        high=high,
        target=target,
        duration=duration,
        within=within,
        needed=needed,
    )


@eqx.filter_jit
def _rebounds(
    law: AbstractLaw,
    contact: Contact,
    velocity: Float[Array, ""],
    step: Float[Array, ""],
    phases: Float[Array, " p"],
    scheme: Scheme,
) -> Float[Array, " p"]:
    """Return e for each phase of the touch: at the end of that step the overlap is v h phase."""
    mass = contact.mass
    force = functools.partial(law.force, contact=contact, impact_velocity=velocity)

    def accelerate(depth: Array, speed: Array) -> Array:
        if scheme is Scheme.SEMI_IMPLICIT:
            return speed - step * force(depth, speed) / mass
        slowest = speed - step * jnp.maximum(force(depth + step * speed, speed), 0) / mass

        def halve(_: int, ends: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = ends
            middle = (low + high) / 2
            later = jnp.maximum(depth + step * middle, 0)
            # The force rises with the velocity, so this function has one zero.
            above = middle - speed + step * force(later, middle) / mass > 0
            return jnp.where(above, low, middle), jnp.where(above, middle, high)

        low, high = jax.lax.fori_loop(0, _NEWTON, halve, (slowest, speed))
        return (low + high) / 2

    def touching(state: tuple[Array, Array, Array]) -> Array:
        _, depth, _ = state
        return jnp.any(depth > 0)

    def on(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        number, depth, speed = state
        inside = depth > 0
        after = jnp.where(inside, accelerate(jnp.where(inside, depth, 0), speed), speed)
        return number + 1, jnp.where(inside, depth + step * after, depth), after

    def going(state: tuple[Array, Array, Array]) -> Array:
        return touching(state) & (state[0] < _LONGEST * _MOST)

    start = jnp.asarray(0), velocity * step * phases, jnp.broadcast_to(velocity, phases.shape)
    _, depth, speed = jax.lax.while_loop(going, on, start)
    return jnp.where(depth > 0, 0, -speed / velocity)

"""The state of a mechanism at its start, and the checks of its equations there."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._contact import Contact
from .._coupled.modes import PerContact
from .._coupled.scalars import Flag, Number
from .._coupled.springs import SMALL, slides_at_touch
from .._friction import SpringSlider
from .._laws import force_of
from .mechanics import Mechanics, Opening, Vector
from .problem import SystemState
from .stick_slip import SLIDES_ON

_ROUNDING = 64
"""A gap of less than this many rounding errors of the lengths in it is closed."""


class StartChecks(NamedTuple):
    """Checks at the start: numbers are finite, M is symmetric and positive definite, and forces,
    gaps and their gradients are finite. `pressed` gaps are negative; `idle` ones neither close nor
    are about to, and wait for a peak. `quadratic`: so is the Lagrangian in v, if there is one.
    """

    finite: Flag
    symmetric: Flag
    definite: Flag
    force: Flag
    quadratic: Flag
    gaps: Float[Array, " m"]
    gradients: Bool[Array, " m"]
    pressed: Bool[Array, " m"]
    idle: Bool[Array, " m"]

    def valid(self, latched: bool) -> Flag:
        """Return whether all holds; pressed gaps need a v0 that is `latched` from elsewhere."""
        parts = [self.finite, self.symmetric, self.definite, self.force, self.quadratic]
        parts += [jnp.all(jnp.isfinite(self.gaps)), jnp.all(self.gradients), ~jnp.any(self.idle)]
        return jnp.all(jnp.stack([*parts, latched | ~jnp.any(self.pressed)]))


def start_of(
    mechanics: Mechanics, time: Number, q: Vector, v: Vector, floor: Number, peak: bool
) -> tuple[SystemState, StartChecks]:
    """Return the state at the start and its checks. A gap that is closed there begins its contact
    now if it closes, else with the next event; a negative gap is in contact.
    """
    opening = mechanics.opening(time, q, v)
    jacobian, mass = mechanics.jacobian(opening), mechanics.mass(time, q)
    nothing, system = jnp.zeros_like(opening.gap), mechanics.system
    elastic = system.stiffness * jnp.maximum(-opening.gap, 0) ** system.exponent
    gradient = jax.jacfwd(lambda q: mechanics.system.gap(time, q, mechanics.args))(q)
    lengths = jnp.sum(jnp.abs(gradient * q[None]), axis=1) + jnp.abs(opening.gap)
    near = jnp.abs(opening.gap) <= _ROUNDING * jnp.finfo(q.dtype).eps * lengths
    slide = None
    if system.rigid:
        slide = jnp.where(near | (opening.gap < 0), mechanics.slide(time, q, v), SLIDES_ON)
    motion = mechanics.motion(time, q, v, opening, elastic, slide)
    second = -mechanics.second(time, q, v, motion.acceleration)
    closing = -opening.rate
    begins = near & ((closing > 0) | ((closing == 0) & (second > 0)))
    pressed = ~near & (opening.gap < 0)
    closed = begins | pressed
    speed = jnp.maximum(jnp.where(closed, closing, 0), 0)
    mass_of_gaps = mechanics.effective_mass(time, q, v)
    # At rest in static contact, both forces cancel but for rounding.
    still = jnp.sqrt(jnp.finfo(q.dtype).eps) * elastic / mass_of_gaps
    idle = pressed & peak & (closing <= 0) & (second <= still)
    state = SystemState(
        time=time,
        position=q,
        velocity=v,
        closing=closing,
        closed=closed,
        rising=closed & (closing <= 0) & peak,
        latched=jnp.where(closed, jnp.maximum(speed, floor), 0),
        mass=mass_of_gaps,
        since=jnp.full_like(nothing, time),
        touch_speed=speed,
        force_until=jnp.full_like(nothing, time),
        parting=nothing,
        max_force=nothing,
        max_depth=nothing,
        lost=nothing,
        work=jnp.zeros_like(time),
        step=jnp.zeros_like(time),
        deepest=nothing if system.law.remembers else None,
    )
    if system.springs:
        state = _with_springs(mechanics, state, opening)
    elif slide is not None:
        state = state._replace(slide=_settled(mechanics, state, opening, slide))
    scale = jnp.sqrt(jnp.abs(jnp.diagonal(mass)))
    scale = jnp.where(scale > 0, scale, 1)
    scaled = mass / scale[None] / scale[:, None]
    finest = jnp.finfo(q.dtype).eps * mass.shape[0]
    skew = jnp.max(jnp.abs(scaled - scaled.T))
    least = jnp.min(jnp.linalg.eigvalsh((scaled + scaled.T) / 2))
    checks = StartChecks(
        finite=jnp.all(jnp.isfinite(q)) & jnp.all(jnp.isfinite(v)) & jnp.isfinite(time),
        symmetric=skew <= 1e3 * finest,
        definite=(least > 8 * finest) & jnp.all(jnp.isfinite(mass)),
        force=jnp.all(jnp.isfinite(motion.acceleration)),
        quadratic=_is_quadratic(mechanics, time, q, v),
        gaps=opening.gap,
        gradients=jnp.all(jnp.isfinite(jacobian), axis=1) & jnp.isfinite(opening.rate),
        pressed=pressed,
        idle=idle,
    )
    return state, jax.lax.stop_gradient(checks)


class _Law(NamedTuple):
    """The force of every contact at the start, and its unit of length in m."""

    force: Callable[[PerContact], PerContact]
    unit: PerContact


def _law_at(mechanics: Mechanics, state: SystemState) -> _Law:
    """Return the forces in N of depths in m, at the closing speeds of the start."""
    system, n = mechanics.system, mechanics.system.exponent
    contact = Contact(state.mass, system.stiffness * jnp.ones_like(state.mass))
    contact = eqx.tree_at(lambda c: c._exponent, contact, system._exponent)
    least = jnp.finfo(state.mass.dtype).tiny ** 0.25
    speed = jnp.maximum(jnp.where(state.rising, state.closing, state.latched), least)
    unit = (state.mass * jnp.square(speed) / system.stiffness) ** (1 / (n + 1))
    return _Law(lambda depth: force_of(system.law, depth, state.closing, contact, speed), unit)


def _settled(
    mechanics: Mechanics, state: SystemState, opening: Opening, slide: PerContact
) -> PerContact:
    """Return the signs of slip at the start, 0 for the contacts that stick."""
    law, depth = _law_at(mechanics, state), jnp.maximum(-opening.gap, 0)
    # A contact that begins has no force yet: a small one shows which part of it holds.
    begins = state.closed & (depth <= 0)
    force = law.force(jnp.where(begins, SMALL * law.unit, depth))
    force = jnp.where(state.closed, force, 0)
    slide = jnp.where(state.closed, slide, SLIDES_ON)
    at = state.time, state.position, state.velocity
    return mechanics.settled(*at, opening, force, slide)[0]


def _with_springs(mechanics: Mechanics, state: SystemState, opening: Opening) -> SystemState:
    """Return the state with tangential springs, and 1 for contacts that slip, 0 for others."""
    friction, system, law = mechanics.system.friction, mechanics.system, _law_at(mechanics, state)
    assert isinstance(friction, SpringSlider) and friction.ratio is not None
    slip = mechanics.slip(state.time, state.position, state.velocity)
    slip = slip.reshape(opening.gap.shape[0], -1)
    # The force of a spring in progress is not known; it begins without.
    depth = SMALL * law.unit
    hardening = law.force(depth) / (system.stiffness * depth**system.exponent)
    slips = slides_at_touch(friction.ratio, slip, state.closing, friction.mu, hardening)
    slides = state.closed & (opening.gap >= 0) & slips
    return state._replace(slide=slides.astype(slip.dtype), spring=jnp.zeros_like(slip))


def _is_quadratic(mechanics: Mechanics, time: Number, q: Vector, v: Vector) -> Flag:
    """Test whether momenta are linear in v; they are without a Lagrangian."""
    energy = mechanics.system._energy
    if energy is None:
        return jnp.asarray(True)
    momentum = jax.grad(lambda v: energy.lagrangian(time, q, v, mechanics.args))
    speeds = 1 + jnp.abs(v)
    expected = mechanics.mass(time, q) @ speeds
    got = momentum(speeds) - momentum(jnp.zeros_like(v))
    allowed = jnp.sqrt(jnp.finfo(q.dtype).eps) * (jnp.max(jnp.abs(expected)) + jnp.abs(got))
    return jnp.all(jnp.abs(got - expected) <= allowed)

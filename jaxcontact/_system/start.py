"""The state of a mechanism at its start, the checks of its equations there, and the errors that
follow from them, by name.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._coupled.modes import Flag, Number, PerContact
from .._coupled.springs import SMALL, slides_at_touch
from .._laws import force_of
from .mechanics import SLIDES_ON, Mechanics, Opening, Vector
from .problem import SystemState, contact_of
from .system import System

_ROUNDING = 64
"""A gap of less than this many rounding errors of the lengths in it is closed."""


class StartChecks(NamedTuple):
    """Checks at the start: numbers are finite, M is symmetric and positive definite, and forces,
    gaps and their gradients are finite. `pressed` gaps are negative; `idle` ones neither close nor
    are about to, and wait for a peak. `quadratic`: so is the Lagrangian in v, if there is one.
    `affine`: so is the slip in v.
    """

    finite: Flag
    symmetric: Flag
    definite: Flag
    force: Flag
    quadratic: Flag
    affine: Flag
    gaps: Float[Array, " m"]
    gradients: Bool[Array, " m"]
    pressed: Bool[Array, " m"]
    idle: Bool[Array, " m"]

    def valid(self, latched: bool) -> Flag:
        """Return whether all holds; pressed gaps need a v0 that is `latched` from elsewhere."""
        parts = [self.finite, self.symmetric, self.definite, self.force]
        parts += [self.quadratic, self.affine]
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
    if system.states:
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
        affine=jnp.asarray(True)
        if system.slip is None
        else _is_affine(lambda v: mechanics.slip(time, q, v), v),
        gaps=opening.gap,
        gradients=jnp.all(jnp.isfinite(jacobian), axis=1) & jnp.isfinite(opening.rate),
        pressed=pressed,
        idle=idle,
    )
    return state, jax.lax.stop_gradient(checks)


def _law_at(
    mechanics: Mechanics, state: SystemState
) -> tuple[Callable[[PerContact], PerContact], PerContact]:
    """Return the forces in N of depths in m, at the closing speeds of the start, and a small depth
    in m.
    """
    system, n = mechanics.system, mechanics.system.exponent
    contact = contact_of(system, state.mass)
    least = jnp.finfo(state.mass.dtype).tiny ** 0.25
    speed = jnp.maximum(jnp.where(state.rising, state.closing, state.latched), least)
    unit = (state.mass * jnp.square(speed) / system.stiffness) ** (1 / (n + 1))
    return lambda depth: force_of(system.law, depth, state.closing, contact, speed), SMALL * unit


def _settled(
    mechanics: Mechanics, state: SystemState, opening: Opening, slide: PerContact
) -> PerContact:
    """Return the signs of slip at the start, 0 for the contacts that stick."""
    (force_at, small), depth = _law_at(mechanics, state), jnp.maximum(-opening.gap, 0)
    # A contact that begins has no force yet: a small one shows which part of it holds.
    begins = state.closed & (depth <= 0)
    force = jnp.where(state.closed, force_at(jnp.where(begins, small, depth)), 0)
    slide = jnp.where(state.closed, slide, SLIDES_ON)
    at = state.time, state.position, state.velocity
    return mechanics.settled(*at, opening, force, slide)[0]


def _with_springs(mechanics: Mechanics, state: SystemState, opening: Opening) -> SystemState:
    """Return the state with tangential springs, and 1 for contacts that slip, 0 for others."""
    system = mechanics.system
    slip = mechanics.slip(state.time, state.position, state.velocity)
    slip = slip.reshape(opening.gap.shape[0], -1)
    # The force of a spring in progress is not known; it begins without.
    state = state._replace(spring=jnp.zeros_like(slip))
    if not system.sticks:
        return state
    mu, kappa = mechanics.spring
    force_at, depth = _law_at(mechanics, state)
    hardening = force_at(depth) / (system.stiffness * depth**system.exponent)
    slips = slides_at_touch(kappa, slip, state.closing, mu, hardening)
    slides = state.closed & (opening.gap >= 0) & slips
    return state._replace(slide=slides.astype(slip.dtype))


def _is_quadratic(mechanics: Mechanics, time: Number, q: Vector, v: Vector) -> Flag:
    """Test whether momenta are affine in v; they are without a Lagrangian."""
    energy = mechanics.system._energy
    if energy is None:
        return jnp.asarray(True)
    return _is_affine(jax.grad(lambda v: energy.lagrangian(time, q, v, mechanics.args)), v)


def _is_affine(function: Callable[[Vector], Array], v: Vector) -> Flag:
    speeds = 1 + jnp.abs(v)
    at_rest, expected = jax.jvp(function, (jnp.zeros_like(v),), (speeds,))
    got = function(speeds) - at_rest
    largest = jnp.max(jnp.abs(expected)) + jnp.max(jnp.abs(at_rest))
    allowed = jnp.sqrt(jnp.finfo(v.dtype).eps) * (largest + jnp.abs(got))
    return jnp.all(jnp.abs(got - expected) <= allowed)


def require_shapes(mechanics: Mechanics, q: Array, v: Array) -> int:
    """Return the number of gaps; raise ValueError for a function with a wrong outcome."""
    arrays, others = eqx.partition((mechanics, q, v), eqx.is_array)
    shapes = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), arrays)
    flat = map(jax.tree.flatten, (shapes, others))
    key = tuple((structure, tuple(leaves)) for leaves, structure in flat)
    try:
        hash(key)
    except TypeError:
        return _gaps_of.__wrapped__(key)
    return _gaps_of(key)


@functools.lru_cache(maxsize=16)
def _gaps_of(key: tuple[tuple[Any, tuple], ...]) -> int:
    """Check functions by tracing, once for each system and each shape of its numbers."""
    mechanics, q, v = eqx.combine(*itertools.starmap(jax.tree.unflatten, key))
    system, t = mechanics.system, jax.ShapeDtypeStruct((), q.dtype)

    def shape(name: str, *at: Any) -> tuple[int, ...]:
        def outcome(system: System, *at: Any) -> Any:
            return getattr(system, name)(*at)

        out: Any = eqx.filter_eval_shape(outcome, system, *at, mechanics.args)
        if not hasattr(out, "shape") or not jnp.issubdtype(out.dtype, jnp.floating):
            got = f"a {type(out).__name__}"
            if hasattr(out, "shape"):
                got = f"{out.dtype} of the shape {out.shape}"
            raise ValueError(
                f"Function `{name}` must return an array of real floats, but returns {got}."
            )
        return out.shape

    def require(name: str, got: tuple[int, ...], *allowed: tuple[int, ...]) -> None:
        if got not in allowed:
            expected = " or ".join(map(str, allowed))
            raise ValueError(
                f"Function `{name}` must return the shape {expected}, but returns {got}."
            )

    if system.rate is not None:
        require("rate", shape("rate", t, q, v), q.shape)
    elif q.shape != v.shape:
        raise ValueError(
            f"Argument `velocity` must have the shape of `position`, {q.shape}, unless the system "
            f"has a `rate`, but has {v.shape}."
        )
    n = v.shape[0]
    require("mass", shape("mass", t, q), (n, n))
    require("force", shape("force", t, q, v), (n,))
    gaps = shape("gap", t, q)
    if len(gaps) != 1 or gaps[0] == 0:
        raise ValueError(
            f"Function `gap` must return an array of the shape (m,), but returns {gaps}."
        )
    if system.slip is not None:
        slip = shape("slip", t, q, v)
        require("slip", slip, gaps, (*gaps, 2))
        if system.rigid and slip != gaps:
            raise ValueError(
                f"Function `slip` must return the shape {gaps} with `RigidCoulomb`, but returns "
                f"{slip}; in space use `SpringSlider`."
            )
        _require_states(system, jax.ShapeDtypeStruct(gaps, q.dtype), slip)
    for number in jax.tree.leaves(system.friction):
        if number.shape not in ((), (1,), gaps):
            raise ValueError(
                f"Friction must hold one number, or one for each of {gaps[0]} gaps, but holds an "
                f"array of the shape {number.shape}."
            )
    return gaps[0]


def _require_states(system: System, normal: Any, slip: tuple[int, ...]) -> None:
    """Raise ValueError for a friction law whose forces and rates of states have other shapes."""
    if not system.states or system.springs:
        return
    law: Any = system.friction
    speeds = jax.ShapeDtypeStruct(slip, normal.dtype)
    found = eqx.filter_eval_shape(type(law).force_and_rate, law, normal, speeds, speeds)
    shapes = [x.shape for x in jax.tree.leaves(found)]
    if shapes != [slip, slip]:
        raise ValueError(
            f"Function `force_and_rate` must return force and rate of the shape {slip}, but "
            f"returns {shapes}."
        )


def require_start(checks: StartChecks, has_v0: bool) -> None:
    """Raise ValueError for a start from which no motion follows."""
    found = jax.tree.map(np.asarray, checks)
    _require(found.finite, "Arguments `position` and `velocity` must be finite, but are not.")
    returns = "Function `mass` must return a"
    _require(found.symmetric, f"{returns} symmetric matrix, but does not at the start.")
    _require(found.definite, f"{returns} positive definite matrix at the start, but does not.")
    for k, (gap, fine, pressed, idle) in enumerate(
        zip(found.gaps, found.gradients, found.pressed, found.idle, strict=True)
    ):
        here = f"Gap {k} is {gap} m at the start"
        _require(
            np.isfinite(gap), f"Function `gap` must be finite, but gap {k} is {gap} at the start."
        )
        _require(
            fine, f"The gradient of `gap` must be finite, but that of gap {k} is not at the start."
        )
        _require(
            has_v0 or not pressed,
            f"{here}, in contact for some time, so that the speed at its touch is unknown; pass "
            'v0="peak" or a number.',
        )
        _require(
            not idle,
            f"{here} and does not close, so that its closing speed has no peak; pass `v0` as a "
            "number.",
        )
    for name, holds, what in (
        ("force", found.force, "be finite, but is"),
        ("slip", found.affine, "be affine in v, as all speeds are, but is"),
        ("lagrangian", found.quadratic, "be quadratic in v, but is"),
    ):
        _require(holds, f"Function `{name}` must {what} not at the start.")


def _require(holds: Any, words: str) -> None:
    if not holds:
        raise ValueError(words)

"""The public functions `impact` and `restitution`, and e without contact and speed."""

from __future__ import annotations

import collections
import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from .._contact import Contact, require_contact
from .._forms import ScaledImpact, scale_of
from .._laws import AbstractLaw, require_law
from .._parameter import (
    POSITIVE,
    Range,
    as_number,
    is_valid,
    refuses_unknown,
    require_broadcast,
    sanitised,
)
from .._program import program, soon_compiled
from .front_door import SPEED, Lanes, Problem, lanes_of, problem_of, uniform
from .methods.by_name import method_of
from .methods.method import AbstractMethod
from .result import Impact, Status


@refuses_unknown
def impact(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    *,
    method: str | AbstractMethod = "auto",
    external_force: ArrayLike | None = None,
) -> Impact:
    """One impact of two bodies: m δ'' = -F(δ, δ') + external force, δ(0) = 0, δ'(0) = velocity.

    Arguments: the law; the contact; the closing `velocity` v0 in m/s, at least
    `VELOCITY_THRESHOLD`. All numbers in them broadcast. `external_force` in N, constant, positive
    when it pushes the bodies together (the weight of a falling ball).

    `method`: a name, or an object that holds the options of a method. "exact" (`jc.Exact`), the
    closed form of the Hunt-Crossley family, the oscillator laws and viscoelastic spheres; "event"
    (`jc.Event`), an adaptive solve that ends with the contact, for every law and under a push;
    "phase" (`jc.Phase`), fixed steps over the phase angle with an error estimate, for laws that
    follow the contact to δ = 0; "auto", the cheapest that is right: "exact" where there is a closed
    form, "event" elsewhere. `Impact.method` says which it was. Derivatives of event solves are best
    at `jc.Event(rtol=1e-11)`.

    Returns an `Impact` in the broadcast shape. Bad lanes are flagged in `.status`, their numbers
    NaN, their neighbours untouched. Raises ValueError for a Python scalar out of range, an exponent
    the law is not made for, or a method that does not apply.

    Source: the energy integral of Hunt & Crossley (1975), doi 10.1115/1.3423596, and the
    references of the laws.
    """
    problem = problem_of(law, contact, velocity, external_force)
    return _impact(problem, method_of(method))


def _impact(problem: Problem, method: AbstractMethod) -> Impact:
    """By one program, which is called sooner, where there is a formula; by two where there is none.

    Of these a small one knows the law, and laws share the other, the solve of their form. Of the
    two, a derivative would have the second one move with everything that the first one returns.
    """
    if any(isinstance(number, Tracer) for number in jax.tree.leaves(problem)):
        return _at_once(problem, method)
    if method.has_formula and problem.external_force is None:
        found = _by_formula(problem, method)
        if found is not None:
            return found
    return _solved(_lanes(problem), method)


class Landing(NamedTuple):
    """What an impact does to bodies that move on under a push, beside its `impact`.

    `end_indentation` in m, at which a force that only pushes vanishes; None where the contact lasts
    until δ = 0. `spare_energy` in J, with which the bodies come to δ = 0, negative where it does
    not suffice; None without a push.
    """

    impact: Impact
    end_indentation: Float[Array, "..."] | None
    spare_energy: Float[Array, "..."] | None


@program
def landing(problem: Problem, method: AbstractMethod, peak: bool = False) -> Landing:
    """An impact, where it ends, and with which energy; `peak` as in `lanes_of`."""
    lanes = lanes_of(problem, peak)
    chosen = method.chosen(lanes.form, lanes.push is not None)
    scaled = chosen.solve(lanes)
    hit = _summary(lanes, chosen, scaled)
    depth = scaled.end_indentation
    if depth is None:
        depth = lanes.form.end_indentation(lanes.n, scaled.restitution)
    good = hit.status == int(Status.SEPARATED)
    if scaled.spare_energy is not None and lanes.knows_no_damping:
        # On the way to δ = 0 and back a constant push gives nothing.
        most = jnp.square(1 + chosen.error(scaled.restitution.dtype)) / 2
        gained = good & (scaled.spare_energy > most)
        status = jnp.where(gained, int(Status.GAINED), hit.status)
        hit = dataclasses.replace(hit, status=status)

    def result(value: Float[Array, "..."] | None, unit: Float[Array, "..."]) -> Any:
        if value is None:
            return None
        value = jnp.where(jnp.isfinite(value), value, 0) * unit
        return jnp.broadcast_to(value, lanes.shape)

    depth = result(depth, lanes.scale.length)
    depth = None if depth is None else jnp.where(good, depth, 0)
    return Landing(hit, depth, result(scaled.spare_energy, 2 * lanes.scale.energy))


@program
def _at_once(problem: Problem, method: AbstractMethod) -> Impact:
    lanes = lanes_of(problem)
    chosen = method.chosen(lanes.form, lanes.push is not None)
    return _summary(lanes, chosen, chosen.solve(lanes))


@program
def _by_formula(problem: Problem, method: AbstractMethod) -> Impact | None:
    lanes = lanes_of(problem)
    chosen = method.chosen(lanes.form, lanes.push is not None)
    return _summary(lanes, chosen, chosen.solve(lanes)) if chosen.has_formula else None


_lanes = program(lanes_of)


@program
def _solved(lanes: Lanes, method: AbstractMethod) -> Impact:
    chosen = method.chosen(lanes.form, lanes.push is not None)
    return _summary(lanes, chosen, chosen.solve(lanes))


def _summary(lanes: Lanes, method: AbstractMethod, scaled: ScaledImpact) -> Impact:
    scale, fill = lanes.scale, functools.partial(jnp.broadcast_to, shape=lanes.shape)
    # Of these two alone: what is not used must stay dead code. A force that is not finite shows.
    # What stays has neither, wherever the solve of its way out came to.
    finite = jnp.isfinite(scaled.restitution + scaled.duration)
    solved = scaled.converged & (finite | scaled.settled)
    parted = int(Status.SEPARATED)
    if lanes.may_gain:
        gained = scaled.restitution > 1 + method.error(scaled.restitution.dtype)
        parted = jnp.where(gained, int(Status.GAINED), parted)
    status = jnp.where(scaled.settled, int(Status.SETTLED), parted)
    status = jnp.where(solved, status, int(Status.NOT_CONVERGED))
    status = fill(jnp.where(lanes.valid, status, int(Status.INVALID_INPUT)))
    good = lanes.valid & solved

    def result(value: Float[Array, "..."], unit: Float[Array, "..."]) -> Float[Array, "..."]:
        # An infinite time stays out of the product: 0 times inf is no derivative of the unit.
        usable = good & jnp.isfinite(value)
        product = jnp.where(usable, value, 1) * unit
        return fill(jnp.where(usable, product, jnp.where(good, value, jnp.nan)))

    one = jnp.ones_like(scale.speed)
    restitution = jnp.where(scaled.settled, 0, scaled.restitution)
    loss = scaled.energy_loss
    loss = (1 - restitution) * (1 + restitution) if loss is None else loss
    return Impact(
        restitution=result(restitution, one),
        rebound_velocity=result(restitution, scale.speed),
        duration=result(jnp.where(scaled.settled, jnp.inf, scaled.duration), scale.time),
        compression_time=result(scaled.compression_time, scale.time),
        max_indentation=result(scaled.max_indentation, scale.length),
        max_force=result(scaled.max_force, scale.force),
        energy_loss=result(jnp.where(scaled.settled, 1, loss), scale.energy),
        status=status,
        error_estimate=jax.tree.map(fill, scaled.error_estimate),
        steps=jax.tree.map(fill, scaled.steps),
        method=method.name,
        min_force=None if scaled.min_force is None else result(scaled.min_force, scale.force),
    )


def restitution(
    law: AbstractLaw,
    contact: Contact | None = None,
    velocity: ArrayLike | None = None,
    *,
    method: str | AbstractMethod = "auto",
) -> Float[Array, "..."]:
    """The restitution e a law delivers in a free impact, and nothing else: no time is computed.

    For the Hunt-Crossley family e solves `α(1+e) = ln[(1+α)/(1-αe)]`, whatever the exponent; for
    the oscillator laws it is elementary. `contact` and the closing `velocity` in m/s are needed
    only where e depends on them; other laws are solved with `impact`.

    Returns e in the broadcast shape, dimensionless, NaN in bad lanes. `method` as in `impact`.
    Raises ValueError for a Python scalar out of range or a missing argument. Inverse, for the exact
    law: `exact_damping_factor`. Source: see `impact`.
    """
    require_law(law)
    if contact is not None:
        require_contact(contact)
    how = method_of(method)
    if contact is not None and velocity is not None:
        return _restitution(problem_of(law, contact, velocity), how)
    speed = None if velocity is None else as_number(velocity, "velocity", SPEED)
    require_broadcast(law=law, contact=contact, velocity=speed)
    e = _restitution_alone((law, contact, speed), how)
    if e is None:
        missing = "contact" if contact is None else "velocity"
        raise ValueError(
            f"Argument `{missing}` is needed for `{type(law).__name__}` by method {how.name!r}, "
            "but is None."
        )
    return e


@program
def _restitution_alone(
    given: tuple[AbstractLaw, Contact | None, float | Float[Array, "..."] | None],
    method: AbstractMethod,
) -> Float[Array, "..."] | None:
    law, contact, velocity = uniform(given)
    valid = is_valid(law)
    scale = None
    if contact is not None:
        valid, contact = valid & is_valid(contact), sanitised(contact)
    if velocity is not None:
        fast = SPEED.holds(velocity)
        valid = valid & fast
        scale = scale_of(contact, jnp.where(fast, velocity, SPEED.inside))
    form, good = sanitised(law).form(contact, scale).sound()
    e = method.chosen(form, pushed=False).restitution(form)
    return None if e is None else jnp.where(good & valid, e, jnp.nan)


@program
def _restitution(
    problem: Problem, method: AbstractMethod, speeds: Range = SPEED
) -> Float[Array, "..."]:
    lanes = lanes_of(problem, speeds=speeds)
    e = method.chosen(lanes.form, pushed=False).restitution(lanes.form)
    if e is None:
        # Under this jit whatever else the solve computes is dead code, and removed.
        return _solved(lanes, method).restitution
    return jnp.broadcast_to(jnp.where(lanes.valid, e, jnp.nan), problem.shape)


def restitution_at_any_speed(
    law: AbstractLaw, contact: Contact, velocity: Float[Array, "..."]
) -> Float[Array, "..."]:
    """As `restitution`, at all speeds above zero: no speed is too small in units of one's own."""
    return _restitution(problem_of(law, contact, velocity), method_of("auto"), POSITIVE)


def restitution_is_constant(law: AbstractLaw, contact: Contact | None) -> bool:
    """Whether e is known to be the same at every speed: its form gives it without one."""
    try:
        found = jax.eval_shape(lambda law: law.form(contact, None).restitution(), law)
    except (TypeError, ValueError):  # the law needs the speed
        return False
    return found is not None


@soon_compiled
def restitutions(
    laws: tuple[Callable[..., AbstractLaw], ...], e: Float[Array, "laws n"]
) -> list[Float[Array, " n"] | None]:
    """The restitution that each law delivers for its own row of parameters e.

    None for a law whose restitution also depends on the contact or the speed; NaN where a parameter
    is out of range. Laws whose forms differ only in their numbers are solved together, since it
    takes longer to compile a solve than to run it.
    """
    groups: dict[Any, list[tuple[int, list[Array]]]] = collections.defaultdict(list)
    for k, made in enumerate(laws):
        try:
            law = made(e=e[k])
            form, good = sanitised(law).form(None, None).sound()
        except (TypeError, ValueError):  # the law needs the contact or the speed
            continue
        numbers, structure = jax.tree.flatten(form)
        columns = [jnp.broadcast_to(x, e[k].shape) for x in (*numbers, good & is_valid(law))]
        groups[structure].append((k, columns))
    delivered: list[Float[Array, " n"] | None] = [None] * len(laws)
    for structure, members in groups.items():
        places, columns = zip(*members, strict=True)
        *numbers, good = map(jnp.stack, zip(*columns, strict=True))
        found = jax.tree.unflatten(structure, numbers).restitution()
        if found is not None:
            for k, row in zip(places, jnp.where(good, found, jnp.nan), strict=True):
                delivered[k] = row
    return delivered

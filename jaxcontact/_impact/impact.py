"""The public functions `impact` and `restitution`, and e without contact and speed."""

from __future__ import annotations

import collections
import dataclasses
import functools
import math
import os
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._contact import Contact, require_contact
from .._entry import (
    POSITIVE,
    Range,
    as_number,
    is_valid,
    refuses_unknown,
    require_broadcast,
    require_flag,
    sanitised,
)
from .._forms import ScaledImpact, scale_of
from .._laws import AbstractLaw, require_law
from .._program import program, quick, side_by_side, soon_options, traced
from .._solver.few_or_many import MANY
from .._text.failure import checked
from .derivatives import common_shape
from .front_door import SPEED, Lanes, Problem, is_known, lanes_of, problem_of, uniform
from .methods.auto import method_of
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
    throw: bool = True,
) -> Impact:
    """Solve an impact of two bodies: m δ'' = -F(δ, δ') + external force, δ(0) = 0, δ'(0) = v0.

    - `law`, `contact`: the contact law and the contact.
    - `velocity`: the closing speed v0 in m/s, at least `VELOCITY_THRESHOLD`.
    - `method`: a name, or an object with the options of a method.
    - `external_force`: in N, constant, positive if it pushes the bodies together (the weight of a
      falling ball).

    All numbers broadcast. The methods are:

    - "exact" (`jc.Exact`): the closed form of the Hunt-Crossley family, the oscillator laws and
      viscoelastic spheres.
    - "event" (`jc.Event`): an adaptive solve that ends with the contact, for every law and with an
      external force.
    - "phase" (`jc.Phase`): fixed steps over the phase angle with an error estimate, for laws whose
      contact lasts until δ = 0.
    - "auto": "exact" if there is a closed form, else "event".

    `Impact.method` names the method used. For derivatives of event solves use
    `jc.Event(rtol=1e-11)`.

    Returns an `Impact` in the broadcast shape. A single one that is NOT_CONVERGED or INVALID_INPUT
    (not SETTLED or GAINED) raises `NumericalError` unless `throw` is False. In arrays and traced
    calls such lanes are NaN, flagged in `.status` and `.ok`, and others unaffected. ValueError: for
    a Python scalar out of range, an exponent the law does not support, a method that cannot apply.

    Source: the energy integral of Hunt & Crossley (1975), doi 10.1115/1.3423596, and the references
    of the laws.
    """
    throw = throw is True or require_flag("throw", throw)
    how = method_of(method)
    formula = how if external_force is None and type(how).has_formula else None
    begun = _begun_again(law, contact, velocity, formula) if external_force is None else None
    if begun is None:
        problem = problem_of(law, contact, velocity, external_force)
        # Under differentiation one program is used, since the second of two would differentiate by
        # all outputs of the first.
        begun = _at_once(problem, how) if traced(problem) else _begun(problem, formula)
    found = _on_cores(begun, how) if isinstance(begun, Lanes) else begun
    return checked(found, throw, "impact")


def _begun_again(law: Any, contact: Any, velocity: Any, method: AbstractMethod | None) -> Any:
    """Return `_begun` of scalars whose structure was computed before; None for others."""
    ours = type(contact) is Contact and issubclass(type(law), AbstractLaw)
    if not ours or type(velocity) is not float or not SPEED.holds(velocity):
        return None
    return _begun(Problem(law, contact.normal, velocity, None), method, again=True)


@program
def _begun(problem: Problem, method: AbstractMethod | None) -> Impact | Lanes:
    """Return the impact if the method has a formula for it, which is faster to call, else its
    lanes. Laws of one form share the program that solves these.
    """
    lanes = lanes_of(problem)
    chosen = None if method is None else method.chosen(lanes.form, False)
    if chosen is None or not chosen.has_formula:
        return lanes
    scaled = chosen.solve(lanes)
    if not lanes.shape:
        # XLA computes what results share for each of them, but does not look into a branch. It runs
        # a program of few operations in the caller's thread. A handover takes as long as a program.
        numbers, rest = eqx.partition((lanes, scaled), eqx.is_array)
        zeros = functools.partial(jax.tree.map, jnp.zeros_like)
        numbers = jax.lax.cond(lanes.valid, lambda numbers: numbers, zeros, numbers)
        lanes, scaled = eqx.combine(numbers, rest)
    return summary(lanes, chosen, scaled)


class Landing(NamedTuple):
    """The effect of an impact on bodies that continue under a push, beside its `impact`.

    `end_indentation` in m is where a force without tension vanishes; None if the contact lasts
    until δ = 0. `spare_energy` in J is the kinetic energy at δ = 0, negative if the bodies do not
    reach it; None without a push.
    """

    impact: Impact
    end_indentation: Float[Array, "..."] | None
    spare_energy: Float[Array, "..."] | None


@program
def landing(problem: Problem, method: AbstractMethod, peak: bool = False) -> Landing:
    """Return an impact with its end indentation and spare energy; `peak` as in `lanes_of`."""
    lanes = lanes_of(problem, peak)
    chosen = method.chosen(lanes.form, lanes.push is not None)
    scaled = chosen.solve(lanes)
    hit = summary(lanes, chosen, scaled)
    depth = scaled.end_indentation
    if depth is None:
        depth = lanes.form.end_indentation(lanes.n, scaled.restitution)
    good = hit.status == int(Status.SEPARATED)
    if scaled.spare_energy is not None and lanes.knows_no_damping:
        # A constant push does no net work on the way to δ = 0 and back.
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


def _of_lanes(lanes: Lanes, method: AbstractMethod) -> Impact:
    chosen = method.chosen(lanes.form, lanes.push is not None)
    return summary(lanes, chosen, chosen.solve(lanes))


_solved = program(_of_lanes)
_run_before: set[Any] = set()
"""Parts of batches that have a program, which each thread would compile otherwise."""


def _on_cores(lanes: Lanes, how: AbstractMethod) -> Impact:
    """Solve lanes, a large batch on a CPU in parts on all cores: XLA runs a loop on one core."""
    shape, distinct = lanes.shape, common_shape((lanes.form, lanes.exponent, lanes.push))
    count = min(os.cpu_count() or 1, math.prod(distinct) // MANY, *distinct[:1])
    cpu = jax.default_backend() == "cpu"
    if count < 2 or len(distinct) < len(shape) or distinct[0] < shape[0] or not cpu:
        return _solved(lanes, how)
    rows = -(-shape[0] // count)

    def part(k: int) -> Lanes:
        at = np.minimum(np.arange(k * rows, (k + 1) * rows), shape[0] - 1)

        def cut(leaf: jax.Array) -> jax.Array:
            whole = leaf.ndim == len(shape) and leaf.shape[0] == shape[0]
            return jnp.asarray(np.asarray(leaf)[at]) if whole else leaf

        return dataclasses.replace(jax.tree.map(cut, lanes), shape=(rows, *shape[1:]))

    parts = [part(k) for k in range(count)]
    kind = jax.tree.structure((parts[0], how)), tuple(map(jax.typeof, jax.tree.leaves(parts[0])))
    at_once = count if kind in _run_before else 1
    _run_before.add(kind)
    found = side_by_side([functools.partial(_solved, part, how) for part in parts], at_once)
    return jax.tree.map(lambda *some: jnp.concatenate(some)[: shape[0]], *found)


_at_once = program(lambda problem, method: _of_lanes(lanes_of(problem), method))


def summary(lanes: Lanes, method: AbstractMethod, scaled: ScaledImpact) -> Impact:
    scale, fill = lanes.scale, functools.partial(jnp.broadcast_to, shape=lanes.shape)
    if lanes.push is None:
        scaled = lanes.form.as_delivered(scaled)
    # A force that is not finite shows in these two. Unused outputs must stay dead code. A settled
    # contact has neither value, regardless of its solve.
    finite = jnp.isfinite(scaled.restitution + scaled.duration)
    solved = scaled.converged & (finite | scaled.settled)
    most = 1 + method.error(scaled.restitution.dtype)
    good = lanes.valid & solved

    def result(value: Float[Array, "..."], unit: Float[Array, "..."]) -> Float[Array, "..."]:
        # An infinite time is kept out of the product, since 0 * inf would spoil its derivative.
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
        status=lanes.status(scaled.restitution, most, scaled.settled, solved),
        error_estimate=jax.tree.map(fill, scaled.error_estimate),
        steps=jax.tree.map(fill, scaled.steps),
        method=method.name,
        min_force=None if scaled.min_force is None else result(scaled.min_force, scale.force),
        solver=method.solved_by,
    )


def restitution(
    law: AbstractLaw,
    contact: Contact | None = None,
    velocity: ArrayLike | None = None,
    *,
    method: str | AbstractMethod = "auto",
) -> Float[Array, "..."]:
    """Return the restitution e that a law delivers in a free impact, without impact times.

    For the Hunt-Crossley family e solves `α(1+e) = ln[(1+α)/(1-αe)]`, independent of the exponent.
    For the oscillator laws it is elementary. Other laws are solved with `impact`. `contact` and the
    closing `velocity` in m/s are needed only if e depends on them.

    Returns e in the broadcast shape, dimensionless, NaN in failed lanes. `method` is as in
    `impact`. Raises ValueError for a Python scalar out of range or a missing argument. The inverse
    for the exact law is `exact_damping_factor`. Source: see `impact`.
    """
    require_law(law)
    if contact is not None:
        require_contact(contact)
    how = method_of(method)
    if contact is not None and velocity is not None:
        e = None
        if type(velocity) is float and SPEED.holds(velocity):
            e = _restitution(Problem(law, contact.normal, velocity, None), how, again=True)
        return _restitution(problem_of(law, contact, velocity), how) if e is None else e
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
    method.chosen(form, pushed=False)  # refuses forms to which the method does not apply
    e = method.restitution(form)
    return None if e is None else jnp.where(good & valid, e, jnp.nan)


@program
def _restitution(
    problem: Problem, method: AbstractMethod, speeds: Range = SPEED
) -> Float[Array, "..."]:
    lanes = lanes_of(problem, speeds=speeds)
    method.chosen(lanes.form, pushed=False)  # refuses forms to which the method does not apply
    e = method.restitution(lanes.form)
    if e is None:
        # Under this jit, unused outputs of the solve are dead code and removed.
        return _solved(lanes, method).restitution
    return jnp.broadcast_to(jnp.where(lanes.valid, e, jnp.nan), lanes.shape)


def restitution_at_any_speed(
    law: AbstractLaw, contact: Contact, velocity: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Return `restitution` for all speeds above zero, without the usual lower limit."""
    return _restitution(problem_of(law, contact, velocity), method_of("auto"), POSITIVE)


def restitution_is_constant(law: AbstractLaw, contact: Contact | None) -> bool:
    """Return whether e is known to be the same at every speed."""
    return is_known(lambda law: law.form(contact, None).restitution(), law)


@functools.partial(quick, options=soon_options)
def restitutions(
    laws: tuple[Callable[..., AbstractLaw], ...], e: Float[Array, "laws n"]
) -> list[Float[Array, " n"] | None]:
    """Return the restitution of each law for its own row of parameters e.

    An entry is None if the restitution also depends on the contact or the speed. It is NaN for
    parameters out of range. Laws whose forms have the same structure are solved together, because
    compiling a solve takes longer than running it.
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

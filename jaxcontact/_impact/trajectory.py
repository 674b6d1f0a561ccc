"""An impact as a function of time."""

from __future__ import annotations

import operator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int

from .._contact import Contact
from .._entry import require_count
from .._functions import bracketed_root, ratio
from .._laws import AbstractLaw
from .._program import program
from .front_door import Problem, lanes_of, problem_of
from .methods.auto import stepping_method
from .methods.event import Event, Solve, Steps, solve_legs
from .methods.method import AbstractMethod
from .motion.coordinates import Number, State
from .motion.ends import Verdict, is_held, on_way_out
from .motion.equation import Motion
from .motion.errors import balance_of, force_is_sharp


class Energy(eqx.Module):
    """The energies of an impact in J, shape (..., samples).

    - `kinetic`: ½ m δ'².
    - `elastic`: ∫ F(δ, 0) dδ, stored in the contact.
    - `dissipated`: the work of damping, integrated along the motion.
    - `external`: the work of the external force.

    `total` = kinetic + elastic + dissipated - external equals the initial energy ½ m v0² up to the
    tolerance. This is an independent check of the solve.
    """

    kinetic: Float[Array, "..."]
    elastic: Float[Array, "..."]
    dissipated: Float[Array, "..."]
    external: Float[Array, "..."]

    @property
    def total(self) -> Float[Array, "..."]:
        """kinetic + elastic + dissipated - external, in J."""
        return self.kinetic + self.elastic + self.dissipated - self.external


class Trajectory(eqx.Module):
    """An impact sampled uniformly in time, from touch to separation; shape (..., samples).

    - `time` in s, `indentation` in m, and `force` in N.
    - `velocity`: δ' in m/s, positive while closing.
    - `energy`, `status`: see `Energy`; the status is as in `Impact`, shape (...).

    A contact that settles is followed until its second turn, at which settling is certain.
    """

    time: Float[Array, "..."]
    indentation: Float[Array, "..."]
    velocity: Float[Array, "..."]
    force: Float[Array, "..."]
    energy: Energy
    status: Int[Array, "..."]


def trajectory(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    *,
    samples: int = 200,
    method: str | AbstractMethod = "auto",
    external_force: ArrayLike | None = None,
) -> Trajectory:
    """Compute the motion of an impact: m δ'' = -F(δ, δ') + external force, δ(0) = 0, δ'(0) = v0.

    - `law`, `contact`, `velocity`, `external_force`: as for `impact`.
    - `samples`: at least 2 equally spaced moments, the first at touch and the last at separation.
    - `method`: "event", or "auto", which is the same here, or a `jc.Event` with options.

    Between the solver's steps the motion is computed by a step of order 8, not by interpolation. A
    contact that creeps forever has no separation and counts as not converged.

    Returns a `Trajectory`. Failed lanes are flagged in `.status`, and their numbers are NaN. Raises
    ValueError as `impact` does, and for other methods. Source: see `impact`.
    """
    samples = require_count("samples", samples, 2)
    problem = problem_of(law, contact, velocity, external_force)
    return _trajectory(problem, stepping_method(method), samples)


class _PathSamples(NamedTuple):
    t: Array
    x: Array
    v: Array
    force: Array
    elastic: Array
    loss: Array
    converged: Array
    settled: Array


@program
def _trajectory(problem: Problem, how: Event, samples: int) -> Trajectory:
    lanes = lanes_of(problem)
    path = how.over(lanes.motion(), eqx.Partial(_path, samples=samples))
    shape, scale = lanes.shape, lanes.scale
    solved = path.converged & jnp.isfinite(path.t[..., -1])

    def along_samples(number: Array) -> Array:
        return number.reshape(number.shape + (1,) * (number.ndim > 0))

    good = along_samples(lanes.valid & solved)

    def result(value: Array, unit: Array) -> Array:
        # One path may represent all lanes, which then differ only in their units.
        value = value.reshape((1,) * (len(shape) + 1 - value.ndim) + value.shape)
        filled = jnp.where(good, value * along_samples(unit), jnp.nan)
        return jnp.broadcast_to(filled, (*shape, samples))

    work = jnp.zeros_like(path.x) if lanes.push is None else along_samples(lanes.push) * path.x
    return Trajectory(
        time=result(path.t, scale.time),
        indentation=result(path.x, scale.length),
        velocity=result(path.v, scale.speed),
        force=result(path.force, scale.force),
        energy=Energy(
            # The unit of energy is ½ m v0²: scaled energies in units of m v0² count double.
            kinetic=result(jnp.square(path.v), scale.energy),
            elastic=result(2 * path.elastic, scale.energy),
            dissipated=result(2 * path.loss, scale.energy),
            external=result(2 * work, scale.energy),
        ),
        status=lanes.status(-path.v[..., -1], 1 + how.error(path.v.dtype), path.settled, solved),
    )


_NEWTON = 30
"""Three are usual. Where time stands still at the end, an error is halved each time."""


def _path(motion: Motion, how: Event, many: bool, samples: int) -> _PathSamples:
    motion = motion.ready()
    legs = solve_legs(motion, Solve(how, many, keep=True)).leg
    turn, end = (jax.tree.map(operator.itemgetter(leg), legs.end) for leg in (0, 1))
    deepest = motion.indentation(turn.w)
    motion = motion.remembering(deepest)
    fractions = jnp.linspace(0, 1, samples, dtype=end.t.dtype)

    def sample(fraction: Number) -> tuple[State, Number, Number, Number, Number]:
        moment = fraction * end.t
        on_way_in = moment <= turn.t
        path = jax.tree.map(lambda leaf: jnp.where(on_way_in, leaf[0], leaf[1]), legs.path)
        state = _state_at(motion, path, jax.lax.stop_gradient(moment), moment, on_way_in)
        # Touch and separation are known, so rounding must not put a sample outside the contact.
        inside = state._replace(w=jnp.maximum(state.w, 0))
        force, loss = motion.force(state, on_way_in), motion.lost(state)
        if not motion.form.remembers:
            return state, motion.indentation(inside.w), force, motion.stored(inside), loss
        now = motion.remembering(jnp.where(on_way_in, 0, deepest))
        x = now.indentation(inside.w)
        # On the way in every indentation is the largest one so far.
        loss = loss + jnp.where(on_way_in, now.form.kept(x), 0)
        return state, x, force, now.stored(inside), loss

    balance = balance_of(motion, end, deepest)
    states, depth, forces, elastic, losses = jax.vmap(sample)(fractions)
    rtol, _ = how.tolerances(end.t.dtype)
    arrived, settled = on_way_out(motion, legs.arrived, end, balance, deepest, rtol)
    sharp = None
    if motion.push is not None and motion.form.remembers:
        sharp = settled | force_is_sharp(motion, end, rtol)
    if motion.form.remembers or motion.adheres:
        settled = settled | is_held(motion, end)
    verdict = Verdict(arrived, settled, sharp=sharp)
    return _PathSamples(
        t=fractions * end.t,
        x=depth.at[0].set(0),
        v=jax.vmap(motion.velocity)(states),
        force=forces if motion.form.tension else jnp.maximum(forces, 0),
        elastic=elastic,
        loss=losses,
        converged=verdict.known,
        settled=verdict.stays,
    )


def _state_at(
    motion: Motion, path: Steps, frozen_moment: Number, moment: Number, compressing: Array
) -> State:
    """Return the state at a time, one step after the last accepted state before it."""
    before = path.taken & (path.states.t <= frozen_moment)
    left = jnp.clip(jnp.sum(before) - 1, 0, jnp.sum(path.taken) - 2)
    moments = jax.lax.stop_gradient(path.moments)
    size = moments[left + 1] - moments[left]
    start = jax.tree.map(lambda leaf: leaf[left], path.states)
    frozen, frozen_start = jax.lax.stop_gradient((motion, start))
    after = jax.tree.map(lambda leaf: leaf[left + 1], jax.lax.stop_gradient(path.states))

    def clock(state: State) -> Number:
        return frozen.rate(state, compressing).t * size

    # A value is used in the step after its computation, else XLA computes it once for each use.
    def improved(carry: tuple[Number, ...]) -> tuple[Number, ...]:
        count, low, high, fraction, missing, change = carry
        begun = count > 0
        low = jnp.where(begun & (missing > 0), fraction, low)
        high = jnp.where(begun & (missing < 0), fraction, high)
        newton = fraction + ratio(missing, change)
        better = jnp.where((newton >= low) & (newton <= high), newton, (low + high) / 2)
        fraction = jnp.where(begun, better, fraction)
        reached = frozen.later(frozen_start, fraction * size, compressing)
        return count + 1, low, high, fraction, frozen_moment - reached.t, clock(reached)

    # Within a step time is nearly a cubic of the fraction. Its root misses by at most 2e-2.
    span = after.t - frozen_start.t
    wanted = ratio(frozen_moment - frozen_start.t, span)
    begin, end = ratio(clock(frozen_start), span), ratio(clock(after), span)
    guess = bracketed_root(
        lambda f: wanted - f * (begin + f * (3 - 2 * begin - end + f * (begin + end - 2))),
        wanted,
        wanted - 1,
        iterations=20,
    )
    zero, rounding = jnp.zeros_like(guess), 4 * jnp.finfo(guess.dtype).eps * frozen_moment
    fraction = jax.lax.while_loop(
        lambda carry: (carry[0] < _NEWTON) & (jnp.abs(carry[4]) > rounding),
        improved,
        (zero, zero, zero + 1, guess, 1 + frozen_moment, zero),
    )[3]
    fraction = jax.lax.stop_gradient(fraction)
    # One Newton step does not change the fraction, but gives it its derivative.
    reached = motion.later(start, fraction * size, compressing)
    missing = moment - reached.t
    change = missing - jax.lax.stop_gradient(missing)
    fraction = fraction + ratio(change, clock(jax.lax.stop_gradient(reached)))
    return motion.later(start, fraction * size, compressing)

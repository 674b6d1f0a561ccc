"""An isolated oblique impact of two bodies with finite duration: the radial problem.

A frictionless pair feels a central force. With r = d - δ, the effective mass μ and the angular
momentum L = μ v_t d its motion is

    r'' = F/μ + L²/(μ² r³) - P/μ,        ψ = ∫ L/(μ r²) dt,

for a constant force P that presses the bodies together. When r is back at d, the tangential speed
is again v_t. The velocities after the impact are then exactly R(ψ) (-e' v_n n + v_t t). In the
units of `Scale`, let x = w^k, dt = w^(k-1) dτ as in `_forms`, κ = X/d and c = κ (v_t/v_n)²:

    w' = v/k,   v' = w^(k-1) (Γ - c/(1-κx)³) - pull(w, v),   t' = w^(k-1),   θ' = w^(k-1)/(1-κx)².

In a shell r = |d| + δ. All of this holds with a negative d, and c presses the bodies together.

Source: the central-force problem, Landau & Lifshitz, Mechanics, sections 13 and 14; event-driven
soft spheres: Müller & Pöschel (2013), doi 10.1103/PhysRevE.87.033301.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._coupled.carry import State, factor, onward
from ..._coupled.modes import Flag, Index, Number
from ..._entry import Specialised
from ..._forms import AbstractForm
from ..._functions import moving, varying
from ..._impact.motion.coordinates import State as Moving
from ..._impact.motion.equation import Motion
from ..._laws import AbstractPlasticForm
from ..._solver.runge_kutta import step_and_slope

# The phases of a contact: until the force peak, until the turn, until the force ends, and until the
# bodies are back at the distance of touch without a force.
_RISES, _CLOSES, _OPENS, _COASTS = range(4)
_W, _U, _T, _THETA, _LOSS = range(5)
_MOST_STEPS = 400
# A Newton correction below this power of rounding, relative to the step that passed the event, is
# the last one. Its square is then below rounding.
_ON_EVENT = 0.65
# A contact held by the push and no faster than this, in units of its speed at touch, creeps to rest
# without a turn.
_CREEPS = 1e-7


def _radial_state(y: State) -> Moving:
    """Return the part of the state that the motion without swirl needs."""
    return Moving(y[_W], y[_U], y[_T], y[_LOSS])


class Radial(eqx.Module):
    """The scaled radial problem of one lane, and the tolerance of a step. `skip` is 1 if the
    solution is not needed.
    """

    form: AbstractForm
    exponent: Specialised
    push: Number
    swirl: Number
    ratio: Number
    skip: Number
    tolerance: Number
    prepared: Number | None = None

    def ready(self) -> Radial:
        """Return the problem with its constants computed in advance, as `Motion.ready` does."""
        return dataclasses.replace(self, prepared=self.motion.ready().prepared)

    def remembering(self, deepest: Number) -> Radial:
        """Return the problem after a turn at the indentation `deepest`; before it that is 0."""
        return dataclasses.replace(self, form=self.form.remembering(deepest))

    @property
    def _n(self) -> Any:
        return self.exponent.value

    @property
    def _order(self) -> int:
        return self.form.order(self._n)

    @property
    def motion(self) -> Motion:
        """The problem without swirl."""
        return Motion(self.form, self.exponent, self.push, prepared=self.prepared)

    def velocity(self, y: State) -> Number:
        """Return x' at a state."""
        return self.motion.velocity(_radial_state(y))

    def still(self, y: State) -> State:
        """Return the state with zero velocity, and with the loss of a contact that unloads."""
        y = jnp.where(np.arange(5) == _U, self.motion.still(_radial_state(y)).u, y)
        if self.form.remembers:
            y = y.at[_LOSS].add(self.form.kept(self.indentation(y)))
        return y

    def indentation(self, y: State) -> Number:
        """Return x at a state."""
        return y[_W] ** self._order

    def start(self) -> State:
        """Return the state at touch."""
        touch = self.motion.start()
        return jnp.stack([touch.w, touch.u, touch.t, touch.t, touch.t])

    def rate(self, y: State, phase: Index) -> State:
        """Return d(w, u, t, θ, loss)/dτ; without a force in the last phase."""
        w, k, n, compressing = y[_W], self._order, self._n, phase < _OPENS
        motion, state, velocity = self.motion, _radial_state(y), self.velocity(y)
        straight = motion.rate(state, compressing)
        assert straight.loss is not None
        apart = 1 - self.ratio * w**k
        # The energy still stored in a clamped contact when its force ends is lost on the way out.
        given_up = -self.form.pull(w, jnp.zeros_like(w), n, jnp.asarray(True)) * velocity
        coasts = phase == _COASTS
        if self.form.remembers:
            # The energy that such a contact does not return is lost at its turn.
            given_up = jnp.zeros_like(given_up)
        loss = jnp.where(coasts, given_up, straight.loss)
        change = straight.u - straight.t * self.swirl / apart**3
        change = change + jnp.where(coasts, motion.pull(state, compressing), 0)
        return jnp.stack([straight.w, change, straight.t, straight.t / apart**2, loss])

    def force(self, y: State, phase: Index) -> Number:
        """Return the scaled force at a state."""
        return self.motion.force(_radial_state(y), phase < _OPENS)

    def gap(self, y: State, phase: Index) -> Number:
        """Return the gap that falls through zero at the end of a phase."""
        rise = jax.jvp(lambda y: self.force(y, phase), (y,), (self.rate(y, phase),))[1]
        apart = y[_W]
        if not self.form.tension:
            if self.form.remembers:
                form = cast(AbstractPlasticForm, self.form)
                pulled = self.push - self.swirl < 0
                force = form.gap(form.left(self.indentation(y)), self.velocity(y), pulled)
            else:
                force = self.motion.gap_of_force(_radial_state(y))
            apart = jnp.where(phase == _OPENS, jnp.minimum(apart, force), apart)
        gaps = [rise, self.velocity(y)]
        return jnp.select([phase == _RISES, phase == _CLOSES], gaps, apart)

    def energy(self, y: State) -> Number:
        """Return the conserved energy: kinetic, stored, lost, and potentials of push and swirl."""
        x = self.indentation(y)
        outwards = x * (2 - self.ratio * x) / (2 * jnp.square(1 - self.ratio * x))
        potential = self.swirl * outwards - self.push * x
        stored = self.form.stored(jnp.maximum(y[_W], 0), self._n)
        return jnp.square(self.velocity(y)) / 2 + stored + y[_LOSS] + potential

    def held(self, y: State) -> Flag:
        """Return whether too little energy is left to separate against the push."""
        left = self.energy(y) - y[_LOSS]
        return self.pressed & (left < -1e-12)

    @property
    def pressed(self) -> Flag:
        """True if push and swirl together press the bodies together."""
        return self.push - self.swirl > 0

    def rest(self) -> tuple[Number, Flag]:
        """Return the static indentation under the push, and whether bodies creep to it; 0 if
        unknown. Near rest y'' + c x^(n-p) y' + n x^(n-1) y = 0. The bodies creep to it, or
        oscillate about it.
        """
        n, static = self._n, self.motion.static_indentation()
        damping = self.form.damping(n, jnp.asarray(True))
        if static is None:
            return jnp.zeros_like(self.push), jnp.asarray(False)
        if damping is None:
            return static, jnp.asarray(False)
        c, p = damping
        return static, jnp.square(c) * static ** (n + 1 - 2 * p) >= 4 * n


class RadialOutcome(NamedTuple):
    restitution: Number
    """The speed at x = 0 over that at touch; `delivered` is that at the end of the force."""
    delivered: Number
    elapsed: Number
    theta: Number
    duration: Number
    max_force: Number
    max_indentation: Number
    energy_loss: Number
    error: Number
    done: Flag
    settled: Flag


class _RadialCarry(NamedTuple):
    y: State
    phase: Index
    size: Number
    """The size of the next step to try; `free` is the size that the error alone allows."""
    free: Number
    whole: Number
    """The step in which an event was first seen; 0 if none is being sought."""
    max_force: Number
    max_indentation: Number
    duration: Number
    delivered: Number
    error: Number
    steps: Index
    done: Flag
    settled: Flag


def solve_radial(problem: Radial) -> RadialOutcome:
    """Solve one lane from touch until x = 0 again, by adaptive steps that end on the events.

    A step that passes one is repeated with a length corrected by Newton's method, until it ends
    there. The last correction is part of the derivative of the event time.
    """
    problem = problem.ready()
    dtype, tolerance = problem.push.dtype, problem.tolerance
    stop = jax.lax.stop_gradient
    frozen = stop(problem)
    on_event = float(jnp.finfo(dtype).eps) ** _ON_EVENT

    def unfinished(c: _RadialCarry) -> Flag:
        return ~c.done & (c.steps < _MOST_STEPS)

    def advance(c: _RadialCarry) -> _RadialCarry:
        phase, now = c.phase, problem.remembering(c.max_indentation)
        fixed = stop(now)

        def rate(y: State) -> State:
            return now.rate(y, phase)

        y, error, _, slope = step_and_slope(rate, c.y, c.size)
        error = jnp.max(jnp.abs(stop(error)) / (1 + jnp.abs(stop(y)))) / tolerance
        fine = error <= 1
        gap, fall = jax.jvp(lambda y: now.gap(y, phase), (y,), (slope,))
        flat = fall == 0
        left = -gap / jnp.where(flat, 1, fall)
        seeking = c.whole > 0
        crossed = gap < 0
        whole = jnp.where(seeking, c.whole, c.size)
        ahead = stop(left)
        small = jnp.abs(ahead) <= on_event * whole
        # On the event, from either side. A step of zero length cannot get closer.
        event = fine & (((crossed | seeking) & small & ~flat) | (crossed & (c.size < 1e-13)))
        taken = fine & (event | ~crossed)
        moved = jnp.where(event & small, left, 0)
        y = jnp.where(event, y + slope * moved, y)
        turned = event & (phase == _CLOSES)
        y = jnp.where(turned, now.still(y), y)
        # Next: shorter if the error requires it, to the event if one was passed, else longer.
        grown = c.size * factor(error)
        size, free = onward(c.size, c.free, grown, ahead, fine, crossed, seeking)
        size = jnp.where(event, free, jnp.minimum(size, c.free))
        whole = jnp.where(fine & (crossed | seeking) & ~event, whole, 0)

        leaves = event & (phase == _OPENS)
        done = (leaves & (y[_W] <= 1e-9)) | (event & (phase == _COASTS))
        peak, deepest = event & (phase == _RISES), turned
        velocity = fixed.velocity(stop(y))
        inwards = (phase >= _OPENS) & taken & ~event & (velocity > 0)
        slow = (phase >= _OPENS) | (jnp.abs(velocity) < _CREEPS)
        slow = slow | (creeping & (phase == _CLOSES))
        settled = fixed.pressed & taken & ((slow & fixed.held(stop(y))) | inwards)
        return _RadialCarry(
            y=jnp.where(taken, y, c.y),
            phase=jnp.where(event & ~done, phase + 1, phase),
            size=size,
            free=free,
            whole=whole,
            max_force=jnp.where(peak, now.force(y, phase), c.max_force),
            max_indentation=jnp.where(deepest, now.indentation(y), c.max_indentation),
            duration=jnp.where(leaves, y[_T], c.duration),
            delivered=jnp.where(leaves, -now.velocity(y), c.delivered),
            error=c.error + jnp.where(taken, error * tolerance, 0),
            steps=c.steps + 1,
            done=done | settled,
            settled=settled,
        )

    static, creeping = problem.rest()
    start = problem.start()
    zero = jnp.zeros_like(start[_T])
    # A strong outward pull ends a contact early, at x of the order of its inverse.
    early = jnp.sqrt(1 + jnp.abs(frozen.push) + jnp.abs(frozen.swirl))
    begin = jnp.asarray(0.1, dtype) / early
    # The force of an overdamped linear contact is largest at touch.
    falls = frozen.gap(stop(start), jnp.asarray(_RISES)) < 0
    first = _RadialCarry(
        y=start,
        phase=jnp.where(falls, _CLOSES, _RISES).astype(jnp.int32),
        size=begin,
        free=begin,
        whole=zero,
        max_force=problem.force(start, jnp.asarray(_RISES)),
        **dict.fromkeys(("max_indentation", "duration", "delivered"), moving(problem, zero)),
        error=zero,
        steps=jnp.zeros((), jnp.int32),
        done=problem.skip > 0,
        settled=jnp.zeros((), bool),
    )
    end = jax.lax.while_loop(unfinished, advance, varying(start[_T], first))
    # A push may add more energy than the bodies had.
    last = stop(end.y)
    largest = 1 + (jnp.abs(frozen.push) + jnp.abs(frozen.swirl)) * frozen.indentation(last)
    frozen = frozen.remembering(stop(end.max_indentation))
    imbalance = jnp.abs((frozen.energy(last) - frozen.energy(stop(start))) / largest)
    e = -problem.velocity(end.y)
    # The error of ½e² as an error of e.
    doubt = jnp.minimum(imbalance / jnp.maximum(stop(e), 1e-6), jnp.sqrt(2 * imbalance))
    # Bodies that creep to rest do not turn: their largest indentation is the static one.
    creeps = end.settled & (end.phase < _OPENS)
    deepest = jnp.where(creeping, static, problem.indentation(end.y))
    deepest = jnp.where(creeps, deepest, end.max_indentation)
    strongest = jnp.maximum(end.max_force, problem.push)
    return RadialOutcome(
        restitution=e,
        delivered=end.delivered,
        elapsed=end.y[_T],
        theta=end.y[_THETA],
        duration=end.duration,
        max_force=jnp.where(creeps, strongest, end.max_force),
        max_indentation=deepest,
        energy_loss=jnp.where(end.settled, 1, 2 * end.y[_LOSS]),
        error=jnp.maximum(doubt, end.error),
        done=end.done,
        settled=end.settled,
    )

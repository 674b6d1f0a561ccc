"""The sticking of one spring and slider: its rate and its limit, when the three forms use which,
and steps of order 8, until a cubic reaches the limit.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.lax import stop_gradient

from .._forms import Flag, Lane
from .._solver import chosen
from .._solver.runge_kutta import step_written_out


class Spring(NamedTuple):
    """A spring that keeps its force (`keeps_force`) or its displacement as the contact grows.

    Its state z is the force φ or the displacement η = φ/(1.5 w), with w = √x. With dt = w dτ

        dz/dτ = g w ψ,  dψ/dτ = -b χ w z;  force: g = 1.5 w, b = 2; displacement: g = 1, b = 3 w.

    The limit of z is Z = w³ (1 + αv) or 2/3 w² (1 + αv). It changes by dZ/dτ = g w T with
    T = c (1 + αv)(v - kα X), X = w⁵; force: c = 1, k = 2/3; displacement: c = 2/3, k = 1.
    """

    keeps_force: bool | Flag

    def either(self, force: Any, displacement: Any) -> Any:
        """Return the number of the spring at hand."""
        if isinstance(self.keeps_force, bool):
            return force if self.keeps_force else displacement
        return jnp.where(self.keeps_force, force, displacement)

    def gain(self, w: Lane) -> Lane:
        """Return g."""
        return self.either(1.5 * w, jnp.ones_like(w))

    def pull(self, w: Lane) -> Lane:
        """Return b."""
        return self.either(jnp.full_like(w, 2), 3 * w)

    def limit(self, w: Lane, v: Lane, alpha: Lane) -> Lane:
        """Return Z, odd in w, so that it changes sign at separation."""
        return w * (1 + alpha * v) * self.either(jnp.square(w), 2 / 3 * jnp.abs(w))

    def slope(self, v: Lane, stored: Lane, alpha: Lane) -> Lane:
        """Return T."""
        return self.either(1.0, 2 / 3) * (1 + alpha * v) * (v - self.damping * alpha * stored)

    def expansion(self, v: Lane, stored: Lane, alpha: Lane) -> tuple[Lane, Lane, Lane]:
        """Return T, dT/dv and d²T/dv², with dX/dv = -5/2 v/(1 + αv)."""
        c, k, y = self.either(1.0, 2 / 3), self.damping, alpha * v
        first = c * (1 + (2 + 2.5 * k) * y - k * jnp.square(alpha) * stored)
        second = c * alpha * (2 + 2.5 * k + 2.5 * k * y / (1 + y))
        return self.slope(v, stored, alpha), first, second

    @property
    def damping(self) -> Any:
        """Return k."""
        return self.either(2 / 3, 1.0)

    @property
    def inflection(self) -> Any:
        """Return the αv at which d²T/dv² = 0: -0.69 or -0.64."""
        return -(2 + 2.5 * self.damping) / (2 + 5 * self.damping)


class SpringForm(NamedTuple):
    """A form of the spring: in loading (v > 0) and in unloading it keeps its force or not."""

    loading: bool
    unloading: bool

    @property
    def changes(self) -> bool:
        """Return whether the spring changes at v = 0."""
        return self.loading != self.unloading

    def spring(self, loading: Flag) -> Spring:
        """Return the spring of lanes that are `loading` or not."""
        return Spring(loading if self.changes else self.loading)


FORMS = {
    "force": SpringForm(True, True),
    "displacement": SpringForm(False, False),
    "rescaled": SpringForm(True, False),
}


# The root starts another trial step, which corrects it. Measured: more steps save no trial.
_ITERATIONS = 4


class Cubic(NamedTuple):
    """The cubic c0 + c1 x + c2 x² + c3 x³ over a step, x from 0 to 1."""

    c0: Lane
    c1: Lane
    c2: Lane
    c3: Lane

    @classmethod
    def through(cls, start: Lane, start_slope: Lane, end: Lane, end_slope: Lane) -> Cubic:
        """Return the cubic with these values and slopes at 0 and 1."""
        rise = end - start
        second = 3 * rise - 2 * start_slope - end_slope
        return cls(start, start_slope, second, start_slope + end_slope - 2 * rise)

    def at(self, x: Lane) -> Lane:
        """Return the value at x."""
        return self.c0 + x * (self.c1 + x * (self.c2 + x * self.c3))

    def slope(self, x: Lane) -> Lane:
        """Return the slope at x."""
        return self.c1 + x * (2 * self.c2 + 3 * x * self.c3)

    def crossing(self) -> Lane:
        """Return about where the cubic, positive at 1, crosses zero upwards: by Newton's steps, or
        by halving where they leave the bracket. A double root at 0 is not one.
        """

        def narrow(_: int, bracket: tuple[Lane, Lane, Lane]) -> tuple[Lane, Lane, Lane]:
            low, x, high = bracket
            value, slope = self.at(x), self.slope(x)
            low, high = jnp.where(value < 0, x, low), jnp.where(value < 0, high, x)
            newton = x - value / jnp.where(slope != 0, slope, 1)
            inside = (newton > low) & (newton < high)
            return low, jnp.where(inside, newton, (low + high) / 2), high

        zero = jnp.zeros_like(self.c0)
        first = (zero, zero + 0.5, zero + 1)
        return jax.lax.fori_loop(0, _ITERATIONS, narrow, first, unroll=True)[1]

    def top(self) -> Lane:
        """Return where in (0, 1) the cubic has its maximum; 0 if it has none."""
        has = (self.c1 > 0) & (self.slope(jnp.ones_like(self.c1)) < 0)
        root = jnp.sqrt(jnp.maximum(jnp.square(self.c2) - 3 * self.c3 * self.c1, 0))
        return jnp.where(has, self.c1 / jnp.where(has, root - self.c2, 1), 0)


# A step in σ. Measured over 60,000 lanes with ψ1 < 8, 0.5 < χ < 2.5 and α < 2, largest error of
# ψ2: 1.7e-10 with 0.3, 4e-11 with 0.25, 7e-12 with 0.2. A contact takes 39 steps at α = 0.
_STEP = 0.2
# Trials with Newton's steps before the bracket alone decides: only a double root needs more.
_NEWTON_TRIALS = 4
# A contact with α = 2 takes 50 steps, a search at most 20.
_MOST_TRIALS = 400


class SpringState(NamedTuple):
    """w = √x of the indentation, normal velocity v, slip speed ψ, and state z of the spring."""

    w: Lane
    v: Lane
    psi: Lane
    z: Lane


class Stuck(NamedTuple):
    """Lanes that stick: state, size of the next trial step, trials in search of the limit, and
    whether the limit is reached.
    """

    state: SpringState
    size: Lane
    trials: Lane
    done: Flag


def loads(v: Lane) -> Flag:
    """Return whether v > 0. At v = 0 both springs of a form change alike, so √eps is as good."""
    return v > jnp.finfo(v.dtype).eps ** 0.5


@jax.jit
def _rate(chi: Lane, alpha: Lane, spring: Spring, state: SpringState) -> SpringState:
    """Return the derivative of the state by σ, where dτ = dσ/(1 + w²).

    By τ, w' = v/2, v' = -w⁴ (1 + αv), z' = g w ψ and ψ' = -b χ w z. Steps in σ need neither the
    total time nor the angle. For one number of steps their error is 60 (α = 0) to 1000 times (α =
    2) smaller than that of steps over the phase angle.
    """
    w, v, psi, z = state
    square = jnp.square(w)
    clock = 1 / (1 + square)
    flow = clock * w
    return SpringState(
        w=clock * v / 2,
        v=-clock * jnp.square(square) * (1 + alpha * v),
        psi=-flow * spring.pull(w) * chi * z,
        z=flow * spring.gain(w) * psi,
    )


def _step(chi: Lane, alpha: Lane, spring: Spring, state: SpringState, size: Lane) -> SpringState:
    def rate(state: SpringState) -> SpringState:
        return _rate(chi, alpha, spring, state)

    def in_branch(state: SpringState) -> SpringState:
        # XLA would compute every stage anew for each use. It does not fuse through a branch.
        always = size.reshape(-1)[0] < jnp.inf
        zeros = jax.tree.map(jnp.zeros_like, state)
        return jax.lax.cond(always, rate, lambda _: zeros, state)

    def of_stage(_: int, state: SpringState) -> SpringState:
        return jax.lax.platform_dependent(state, cpu=in_branch, default=rate)

    return step_written_out(of_stage, state, size)[0]


def _excess(spring: Spring, state: SpringState, sign: Lane, alpha: Lane) -> tuple[Lane, Lane, Lane]:
    """Return |z| - Z, its slope, and Z; `sign` is that of z."""
    w, v, psi, z = state
    depth = jnp.abs(w)
    growth = depth * spring.gain(depth) / (1 + jnp.square(w))
    slope = spring.slope(v, w * jnp.square(jnp.square(w)), alpha)
    limit = spring.limit(w, v, alpha)
    return sign * z - limit, growth * (sign * psi - slope), limit


class Trial(NamedTuple):
    """The verdict on a trial step. It is `taken` or not, `arrived` at the limit or `over` it. The
    `factor` changes a step that is not taken.
    """

    taken: Flag
    arrived: Flag
    over: Flag
    factor: Lane


def _judged(
    before: SpringState, after: SpringState, stuck: Stuck, spring: Spring, alpha: Lane
) -> Trial:
    """Return what a trial step shows.

    A step that passes the limit is tried again up to the root of the cubic, then by Newton's
    method. A step over the maximum of the cubic is cut there, if that comes near the limit. The
    error of the outcome is of second order in that of the root.
    """
    size, eps = stuck.size, float(jnp.finfo(stuck.size.dtype).eps)
    sign = jnp.where(after.z < 0, -1, 1).astype(size.dtype)
    start, start_slope, _ = _excess(spring, before, sign, alpha)
    end, end_slope, limit = _excess(spring, after, sign, alpha)
    cubic = Cubic.through(start, size * start_slope, end, size * end_slope)
    # A spring that has just stopped sliding is at its limit, with slope zero, up to rounding. The
    # root is looser, so that no excess lies between both.
    over = (end > 100 * eps * jnp.abs(limit)) | (after.w < 0)
    searching = stuck.trials > 0
    arrived = searching & (jnp.abs(end) <= eps**0.6 * jnp.abs(limit) + 4 * eps)
    top = cubic.top()
    # The cubic is right to about 1e-5.
    peaks = (cubic.at(top) > -1e-2 * limit) & (top > 1e-3) & (top < 0.99) & ~over & ~searching
    newton = 1 - end / jnp.where(end_slope > 0, size * end_slope, jnp.inf)
    quick = searching & (stuck.trials <= _NEWTON_TRIALS) & (newton > 0.5) & (newton < 1.2)
    quick &= newton != 1
    factor = jnp.where(quick, newton, jnp.where(over, cubic.crossing(), top))
    return Trial(arrived | ~(over | peaks | quick), arrived, over, factor)


def _stopped_at_turn(
    trial: Trial, before: SpringState, after: SpringState, size: Lane, alpha: Lane
) -> tuple[Trial, Flag]:
    """Return a trial that ends at v = 0 at the latest, and whether it ends there."""

    def slope(state: SpringState) -> Lane:
        square = jnp.square(state.w)
        return size * jnp.square(square) * (1 + alpha * state.v) / (1 + square)

    loading = loads(before.v)
    past = loading & loads(-after.v)
    turn = Cubic.through(-before.v, slope(before), -after.v, slope(after)).crossing()
    taken = trial.taken & ~past
    factor = jnp.where(past, turn, trial.factor)
    stopped = Trial(taken, trial.arrived & ~past, trial.over & ~past, factor)
    return stopped, taken & loading & ~loads(after.v)


def stick(state: SpringState, still: Flag, chi: Lane, alpha: Lane, form: SpringForm) -> Stuck:
    """Follow the lanes that are not `still` until their spring reaches its limit.

    The ends of steps do not move with the numbers of a derivative. That is allowed, as sticking and
    sliding have the same rates where one follows the other.
    """
    fixed = stop_gradient(alpha)

    def advance(carry: tuple[Stuck, jax.Array]) -> tuple[Stuck, jax.Array]:
        stuck, count = carry
        before, size = stuck.state, stuck.size
        spring = form.spring(loads(stop_gradient(before.v)))
        after = _step(chi, alpha, spring, before, size)
        ends = stop_gradient((before, after))
        trial = _judged(*ends, stuck, spring, fixed)
        past = trial.over
        if form.changes:
            trial, turned = _stopped_at_turn(trial, *ends, size, fixed)
            past = trial.over
            displacement = after.z / (1.5 * jnp.where(turned, after.w, 1))
            after = after._replace(z=jnp.where(turned, displacement, after.z))
        moved = Stuck(
            state=chosen(trial.taken, after, before),
            size=jnp.where(trial.taken, _STEP, size * trial.factor),
            trials=stuck.trials + (past | (stuck.trials > 0)).astype(size.dtype),
            done=trial.arrived,
        )
        return chosen(stuck.done, stuck, moved), count + 1

    zero = jnp.zeros_like(state.w)
    start = Stuck(state, zero + _STEP, zero, still)
    return jax.lax.while_loop(
        lambda carry: jnp.any(~carry[0].done) & (carry[1] < _MOST_TRIALS),
        advance,
        (start, jnp.asarray(0)),
    )[0]

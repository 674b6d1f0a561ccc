"""The tangential part of an oblique impact with one spring and slider, phase by phase.

Sliding is a formula in the normal velocity. Sticking is a linear motion, in steps of order 8. The
phases alternate until the bodies separate.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.lax import stop_gradient
from jaxtyping import ArrayLike

from .._forms import Flag, Lane, differentiated_forward, restitution_of
from .._forms.hunt_crossley import stored_at
from .._solver import chosen
from .sticking import FORMS, SpringForm, SpringState, Stuck, loads, stick

# Steps of order 3 from one side. The error of the outcome is of second order in that of the root.
_ITERATIONS = 7


class Normal(NamedTuple):
    """The normal motion x'' = -x^1.5 (1 + α x'), from v = 1 at touch to v = -e at separation."""

    alpha: Lane
    e: Lane

    def stored(self, v: Lane) -> Lane:
        """Return X = x^(5/2) at the velocity v."""
        return 2.5 * stored_at(v, self.alpha, jnp.where(v > 0, 1, -self.e))


class SlidingPhase(NamedTuple):
    """A contact that slides from the velocity v = `start` on, in the direction s = `sign`."""

    psi: Lane
    start: Lane
    sign: Lane

    def psi_at(self, v: Lane, chi: Lane) -> Lane:
        """Return ψ = ψ_a - 2χ s (v_a - v)."""
        return self.psi - 2 * chi * self.sign * (self.start - v)

    def end(self, chi: Lane, normal: Normal, form: SpringForm) -> tuple[Lane, Flag]:
        """Return the velocity at which the sliding ends, and whether it lasts to separation.

        It lasts while S(v) = s ψ(v) - T(v) ≥ 0. S'' = -T'' < 0 except for αv below the inflection
        of T, where S' > 2χ. So S has one root if S(-e) < 0, else none. Steps from the inflection,
        or from -e if it is not reached, approach the root from one side.
        """
        alpha = normal.alpha

        def excess(v: Lane) -> tuple[Lane, Lane, Lane]:
            value, first, second = form.spring(v > 0).expansion(v, normal.stored(v), alpha)
            return self.sign * self.psi_at(v, chi) - value, 2 * chi - first, -second

        def improved(_: int, v: Lane) -> Lane:
            value, first, second = excess(v)
            newton = value / first
            return jnp.clip(v - newton / (1 - newton * second / (2 * first)), last, self.start)

        last, eps = -normal.e, float(jnp.finfo(alpha.dtype).eps)
        # A stop so late changes ψ by S(-e)². Its stick would stay within rounding of the limit.
        lasts, begins = excess(last)[0] >= -4 * eps**0.5, excess(self.start)[0] >= 0
        bend = form.spring(last > 0).inflection / jnp.maximum(alpha, 0.1)
        guess = jnp.minimum(self.start, jnp.maximum(last, bend))
        root = jax.lax.fori_loop(0, _ITERATIONS, improved, guess)
        return jnp.where(begins, root, self.start), begins & lasts


# With α up to 2 a tenth of the lanes sticks twice; all of 60,000 ended within these.
_MOST_PAIRS = 4
# Lanes that stick are followed in groups of similar ones, whose steps stay in the fast memory.
_GROUP = 128


class SliderPhases(NamedTuple):
    """The outcome of the tangential motion, in the unit μ/κ of ψ and the speed v0 of v.

    - `psi2`: ψ at separation.
    - `stop`: v at which the first sliding ends; 1 if the contact sticks at touch, -e if it slides
      throughout. Without derivative.
    - `slip`: v at which the last sliding begins; 1 if it slides throughout, -e if it does not
      slide. Without derivative.
    - `converged`: whether all phases were followed to their ends.
    """

    psi2: Lane
    stop: Lane
    slip: Lane
    converged: Flag


def slider_phases(psi1: ArrayLike, chi: ArrayLike, alpha: ArrayLike, form: str) -> SliderPhases:
    """Solve the tangential motion of an impact with the normal motion x'' = -x^1.5 (1 + α x').

    ψ' = -2χ φ with |φ| ≤ F = x^1.5 (1 + αv), φ = f/μ, ψ = κ u/μ; in stick φ' = 3/2 √x ψ (`form`
    "force"), φ = 3/2 √x η and η' = ψ ("displacement"), or the first while v > 0 and the second
    after it ("rescaled").

    Arguments: `psi1` ≥ 0, `chi` > 0, `alpha` ≥ 0, dimensionless; shapes broadcast. They are not
    checked. Error of ψ2 for ψ1 < 8, 0.5 < χ < 2.5, α < 2: below 1e-11. Differentiable once, forward
    and reverse; the derivative is continuous at all transitions. Source of the forms: Thornton,
    Cummins & Cleary (2011), doi 10.1016/j.powtec.2011.01.013.
    """
    numbers = jnp.broadcast_arrays(*(jnp.asarray(x) for x in (psi1, chi, alpha)))
    shape, kind = numbers[0].shape, jnp.result_type(*numbers, float)
    count = numbers[0].size
    spare = 0 if count <= _GROUP else -count % _GROUP
    flat = [jnp.pad(x.astype(kind).reshape(-1), (0, spare), mode="edge") for x in numbers]

    def of_lanes(psi1: Lane, chi: Lane, alpha: Lane) -> SliderPhases:
        return _solve(psi1, chi, alpha, FORMS[form])

    outcome = differentiated_forward(of_lanes, of_lanes)(*flat)
    outcome = jax.tree.map(lambda x: x[:count].reshape(shape), outcome)
    return outcome._replace(converged=outcome.converged > 0)


class _PhaseEnd(NamedTuple):
    """Lanes between two phases: ψ, v, the sign of sliding, `stop` and `slip` so far, done, good."""

    sliding: SlidingPhase
    stop: Lane
    slip: Lane
    done: Flag
    good: Flag


def _solve(psi1: Lane, chi: Lane, alpha: Lane, form: SpringForm) -> SliderPhases:
    """Return the outcome of lanes in one axis; `converged` as a number, which has a tangent.

    Where phases meet is not differentiated: there, both have the same rates.
    """
    normal = Normal(alpha, restitution_of(alpha))
    fixed_chi, fixed_normal = stop_gradient((chi, normal))
    last = -fixed_normal.e

    def pair(carry: tuple[_PhaseEnd, jax.Array]) -> tuple[_PhaseEnd, jax.Array]:
        course, count = carry
        sliding = course.sliding
        v, lasts = stop_gradient(sliding).end(fixed_chi, fixed_normal, form)
        ends = course.done | lasts
        state = _at_stop(sliding, jnp.where(ends, 0, v), chi, normal, form)
        stuck = _stick_in_groups(state, ends, chi, alpha, form)
        z = stop_gradient(stuck.state.z)
        onward = SlidingPhase(
            stuck.state.psi, stuck.state.v, jnp.where(z < 0, -1, 1).astype(z.dtype)
        )
        # A spring without force is at its limit only at separation, and does not slide any more.
        parted = jnp.abs(z) <= 8 * jnp.finfo(z.dtype).eps
        slid = SlidingPhase(sliding.psi_at(-normal.e, chi), -normal.e, sliding.sign)
        new = _PhaseEnd(
            sliding=chosen(lasts, slid, onward),
            stop=jnp.where(count > 0, course.stop, jnp.where(lasts, last, v)),
            slip=stop_gradient(jnp.where(lasts, sliding.start, onward.start)),
            done=lasts | ~stuck.done | parted,
            good=lasts | stuck.done,
        )
        return chosen(course.done, course, new), count + 1

    one = jnp.ones_like(psi1)
    touch = _PhaseEnd(SlidingPhase(psi1, one, one), one, one, one < 0, one > 0)
    course, _ = jax.lax.while_loop(
        lambda carry: jnp.any(~carry[0].done) & (carry[1] <= _MOST_PAIRS),
        pair,
        (touch, jnp.asarray(0)),
    )
    good = (course.done & course.good).astype(psi1.dtype)
    return SliderPhases(course.sliding.psi, course.stop, course.slip, good)


def _at_stop(
    sliding: SlidingPhase, v: Lane, chi: Lane, normal: Normal, form: SpringForm
) -> SpringState:
    """Return the state of a contact whose sliding stops at v, with the spring at its limit."""
    stored = normal.stored(v)
    touching = stored <= 0
    w = jnp.where(touching, 0, jnp.where(touching, 1, stored) ** 0.2)
    z = sliding.sign * form.spring(loads(v)).limit(w, v, normal.alpha)
    return SpringState(w, v, sliding.psi_at(v, chi), z)


def _stick_in_groups(
    state: SpringState, still: Flag, chi: Lane, alpha: Lane, form: SpringForm
) -> Stuck:
    """Return `stick` of all lanes, by groups that start at similar velocities.

    The lanes of a group take as many steps as its slowest one. Lanes that are `still` take none.
    """
    if still.size <= _GROUP:
        return stick(state, still, chi, alpha, form)
    order = jnp.argsort(jnp.where(still, 2, -stop_gradient(state.v)))
    moving = jnp.sum(~still)

    def follow(index: jax.Array, out: Stuck) -> Stuck:
        rows = jax.lax.dynamic_slice(order, (index * _GROUP,), (_GROUP,))
        group = jax.tree.map(lambda x: x[rows], state)
        followed = stick(group, still[rows], chi[rows], alpha[rows], form)
        return jax.tree.map(lambda x, new: x.at[rows].set(new), out, followed)

    zero = jnp.zeros_like(alpha)
    out = Stuck(state, zero, zero, still)
    return jax.lax.fori_loop(0, (moving + _GROUP - 1) // _GROUP, follow, out)

"""An isolated impact of two bodies with finite duration: by a formula, or by the radial problem."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ..._contact import Contact
from ..._coupled.modes import Flag, Index, Number
from ..._entry import POSITIVE, Specialised
from ..._forms import AbstractForm, ScaledImpact
from ..._impact import Status
from ..._impact.derivatives import with_sensitivity
from ..._impact.front_door import lanes_of, problem_of, uniform
from ..._laws import AbstractLaw
from ..result import SolvedBy
from .radial import Radial, RadialOutcome, solve_radial


class ObliqueRebound(NamedTuple):
    """The outcome of one impact of two bodies, in SI units.

    - `restitution`: e' = outgoing over incoming normal speed, when the indentation is zero again.
    - `delivered`: the same when the force ends, which is the e of the impact.
    - `turn`: the turn ψ of the line of centres in rad.
    - `elapsed`: in s until the indentation is zero again.
    - `duration`: in s until the force ends; it differs from `elapsed` only for clamped laws.
    - `max_force` in N, `max_indentation` in m, `energy_loss` in J.
    - `error_estimate`: of the velocities, relative to the normal speed.
    - `solved_by`: a `SolvedBy`, CLOSED_FORM or RADIAL.
    - `status`: a `jaxcontact._impact.Status`.

    Numbers are NaN unless the status is SEPARATED or SETTLED. A settled contact has e' = 0 and
    infinite times.
    """

    restitution: Number
    delivered: Number
    turn: Number
    elapsed: Number
    duration: Number
    max_force: Number
    max_indentation: Number
    energy_loss: Number
    error_estimate: Number
    solved_by: Index
    status: Index


def _goal(rtol: Number, share: float) -> Number:
    """Return a share of `rtol`, but no less than the precision allows. A formula needs a tenth. A
    step needs a hundredth, as the error of the outcome is about ten times larger.
    """
    return jnp.maximum(share * rtol, 20 * float(jnp.finfo(rtol.dtype).eps))


def oblique(
    law: AbstractLaw,
    contact: Contact,
    normal_speed: Number,
    tangential_speed: Number,
    distance: Number,
    pull: Number,
    *,
    rtol: float | Number,
    needed: bool | Flag = True,
    free: bool = False,
    by_formula: bool = False,
) -> ObliqueRebound:
    """Solve one isolated impact of two bodies: rebound speed, duration, and turn.

    All arguments are scalars of one lane; batch with `vmap`.

    - `law`, `contact`: the law, and the contact with the effective mass.
    - `normal_speed`, `tangential_speed`: along the normal, > 0, and across it, in m/s.
    - `distance`: R1 + R2 in m, infinite for a plane, negative inside a shell.
    - `pull`: a constant force in N along the normal, positive if it presses the bodies together.
    - `rtol`: bounds the estimated error of velocities relative to `normal_speed`; at least 1e-5 in
      float32.
    - `needed`: if False, as in some lanes of a batch, no step is taken and the outcome is
      meaningless.
    - `free`: if True, the impact is known to be head-on without a pull. The program then holds only
      the closed form.
    - `by_formula`: if True, the closed form is known to be accurate enough, if the form has one.

    The closed form is used if turning and pull change less than rtol/10, else the radial problem is
    solved. The law's v0 is the speed at touch. Differentiable in both modes: the solve carries its
    sensitivities. Nothing is raised; see `ObliqueRebound.status`.
    """
    if law.ends_apart or law.forgets:
        return _adhesive(jnp.asarray(normal_speed))
    problem = uniform(problem_of(law, contact, normal_speed))
    # A scene has no lower limit on speeds, as its units are arbitrary.
    lanes = lanes_of(problem, speeds=POSITIVE)
    scale, dtype = lanes.scale, problem.velocity.dtype
    lengths = (jnp.asarray(value, dtype) for value in (tangential_speed, distance, pull))
    across, distance, pull = lengths
    rtol = jax.lax.stop_gradient(jnp.asarray(rtol, dtype))
    sound = lanes.valid & jnp.isfinite(across) & (distance != 0) & jnp.isfinite(pull)
    across, pull = jnp.where(sound, across, 0), jnp.where(sound, pull, 0)
    distance = jnp.where(sound, distance, 1)
    ratio = scale.length / distance
    sound = sound & (jnp.abs(ratio) < 0.5)
    ratio = jnp.where(sound, ratio, 0)
    swirl = jnp.square(across / scale.speed) * ratio
    push = pull / scale.force
    # The constants of a law without parameters have a precision of their own.
    form = jax.tree.map(
        lambda x: jnp.asarray(x, dtype) if eqx.is_inexact_array(x) else x, lanes.form
    )
    closed = form.solve(lanes.n) if form.closed_form else None
    numbers = (form, lanes.exponent, push, swirl, ratio)
    if free and closed is not None:
        no_error, way = jnp.zeros_like(swirl), jnp.full(swirl.shape, int(SolvedBy.CLOSED_FORM))
        out = _free(closed, _back(form, lanes.exponent, closed), no_error)
    else:
        out, way = _cheapest_solution(
            numbers, closed, across / scale.speed, rtol, needed, by_formula
        )
    converged = out.done
    settled = converged & out.settled
    status = jnp.where(settled, int(Status.SETTLED), int(Status.SEPARATED))
    status = jnp.where(converged, status, int(Status.NOT_CONVERGED))
    status = jnp.where(sound, status, int(Status.INVALID_INPUT))
    usable = sound & converged

    def result(value: Number, unit: Number, if_settled: float | None = None) -> Number:
        kept = usable & jnp.isfinite(value)
        if if_settled is not None:
            kept = kept & ~settled
        product = jnp.where(kept, value, 1) * unit
        other = jnp.asarray(jnp.nan if if_settled is None else if_settled, dtype)
        return jnp.where(kept, product, jnp.where(usable & settled, other, jnp.nan))

    unit = jnp.ones_like(scale.speed)
    return ObliqueRebound(
        restitution=result(out.restitution, unit, 0.0),
        delivered=result(out.delivered, unit, 0.0),
        turn=result(out.theta, across / scale.speed * ratio, 0.0),
        elapsed=result(out.elapsed, scale.time, jnp.inf),
        duration=result(out.duration, scale.time, jnp.inf),
        max_force=result(out.max_force, scale.force),
        max_indentation=result(out.max_indentation, scale.length),
        energy_loss=result(out.energy_loss, scale.energy),
        error_estimate=jnp.where(usable, out.error, jnp.nan),
        solved_by=way,
        status=status,
    )


def _adhesive(speed: Number) -> ObliqueRebound:
    """Return an outcome that sends an adhesive contact to the coupled solve."""
    none = jnp.full_like(speed, jnp.nan)
    way, settled = jnp.asarray(int(SolvedBy.RADIAL)), jnp.asarray(int(Status.SETTLED))
    return ObliqueRebound(*(none,) * 9, solved_by=way, status=settled)


def _cheapest_solution(
    numbers: tuple[AbstractForm, Specialised, Number, Number, Number],
    closed: ScaledImpact | None,
    sliding: Number,
    rtol: Number,
    needed: bool | Flag,
    by_formula: bool,
) -> tuple[RadialOutcome, Index]:
    """Return the outcome by the closed form where it is accurate, else by the radial problem, and
    that way; `sliding` is v_t/v_n.
    """
    form, exponent, push, swirl, ratio = numbers
    closed_form, way = int(SolvedBy.CLOSED_FORM), jnp.full(swirl.shape, int(SolvedBy.RADIAL))
    skip, formula = ~jnp.asarray(needed), None
    if closed is not None:
        back = _back(form, exponent, closed)
        bent = jnp.abs(push) + jnp.abs(swirl) + jnp.abs(sliding) * jnp.square(ratio)
        bent = 2 * bent * (1 + back)
        formula, unbent = _free(closed, back, bent), bent < _goal(rtol, 0.1)
        way = jnp.where(unbent, closed_form, way)
        if by_formula:
            return formula, way
        skip = skip | unbent
    tolerance = _goal(rtol, 0.01)
    radial = Radial(
        *jax.tree.map(jax.lax.optimization_barrier, numbers),
        skip=jax.lax.stop_gradient(jnp.where(skip, jnp.ones_like(swirl), 0)),
        tolerance=tolerance,
    )
    out = with_sensitivity(solve_radial)(radial)
    credible = out.error <= jnp.maximum(100 * rtol, 1e3 * tolerance)
    out = out._replace(done=out.done & (out.settled | credible))
    if formula is None:
        return out, way
    # A settled contact has no numbers to select.
    out = jax.tree.map(lambda a, b: jnp.where(way == closed_form, a, b), formula, out)
    return out, way


def _back(form: AbstractForm, exponent: Specialised, closed: ScaledImpact) -> Number:
    """Return the time at which the bodies of a free impact are at x = 0 again. After a force
    without tension vanishes, they move at constant speed.
    """
    depth = closed.end_indentation
    if depth is None:
        depth = form.end_indentation(exponent.value, closed.restitution)
    if depth is None:
        return closed.duration
    parts = closed.restitution > 0
    return closed.duration + jnp.where(parts, depth, 0) / jnp.where(parts, closed.restitution, 1)


def _free(closed: ScaledImpact, back: Number, error: Number) -> RadialOutcome:
    """Return the free impact, which reaches x = 0 at `back`, as an outcome with the given error."""
    loss, e = closed.energy_loss, closed.restitution
    return RadialOutcome(
        restitution=e,
        delivered=e,
        elapsed=back,
        theta=back,
        duration=closed.duration,
        max_force=closed.max_force,
        max_indentation=closed.max_indentation,
        energy_loss=(1 - e) * (1 + e) if loss is None else loss,
        error=error,
        done=jnp.asarray(closed.converged),
        settled=jnp.asarray(closed.settled),
    )

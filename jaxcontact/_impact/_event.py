"""One impact by an event-terminated adaptive solve: touch to turn, then turn to the end."""

from __future__ import annotations

import operator

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Int

from ._form import Flag, GeneralForm
from ._motion import Motion, State
from ._peak import Path, largest_force
from ._scaled import Scaled

# Far beyond any contact: a nominal end close to the event makes the step controller stall.
_FAR = 1e12
# The controller bounds the error of a step. Measured, the outcome is up to twenty times worse.
_SAFETY = 0.02


class EventOptions(eqx.Module):
    """How to solve. All static but the solver's own parameters."""

    solver: diffrax.AbstractSolver
    adjoint: diffrax.AbstractAdjoint
    rtol: float = eqx.field(static=True)
    atol: float = eqx.field(static=True)
    max_steps: int = eqx.field(static=True)


class Leg(eqx.Module):
    """One half of an impact: its last state, all accepted states, and whether its event came."""

    end: State
    path: Path
    arrived: Bool[Array, ""]
    steps: Int[Array, ""]


def solve_leg(motion: Motion, start: State, compressing: Flag, options: EventOptions) -> Leg:
    """From touch to the turn, or from the turn to the end, whichever `compressing` says."""

    def rate(t: object, state: State, motion: Motion) -> State:
        return motion.rate(state, compressing)

    def gap(t: object, y: State, args: Motion, **kwargs: object) -> Array:
        # diffrax compares it with a Python 0.0, which has the default precision.
        return args.gap(y, compressing).astype(jnp.zeros(()).dtype)

    # Neither a step nor a root can be asked for more than rounding lets them have.
    rounding = float(jnp.finfo(start.u.dtype).eps)
    finest = 10 * rounding
    # Python numbers would give the time the default precision, and the state with it. A first step
    # given as an array would be checked at run time, by a callback: the controller chooses it.
    dtype = start.w.dtype
    # The moment of the event is a root of the last step's interpolant: cheap to find sharply.
    # At 30 roundings one lane in a thousand kept stepping to and fro; at 100 none of 8000.
    sharp = max(_SAFETY * min(options.rtol, options.atol), 10 * finest)
    finder = optx.Newton(rtol=sharp, atol=sharp)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(rate),
        options.solver,
        t0=jnp.zeros((), dtype),
        t1=jnp.asarray(_FAR, dtype),
        dt0=None,
        y0=start,
        args=motion,
        saveat=diffrax.SaveAt(t0=True, steps=True),
        stepsize_controller=diffrax.PIDController(
            rtol=max(_SAFETY * options.rtol, finest), atol=max(_SAFETY * options.atol, finest)
        ),
        event=diffrax.Event(gap, finder, direction=False),
        adjoint=options.adjoint,
        max_steps=options.max_steps,
        throw=False,
    )
    assert solution.ts is not None and solution.ys is not None
    steps = solution.stats["num_accepted_steps"]
    return Leg(
        end=jax.tree.map(lambda leaf: leaf[steps], solution.ys),
        path=Path(solution.ts, solution.ys, jnp.arange(solution.ts.size) <= steps),
        arrived=jnp.asarray(solution.result == diffrax.RESULTS.event_occurred),
        steps=steps,
    )


def solve_legs(motion: Motion, options: EventOptions) -> tuple[Leg, Bool[Array, "2"]]:
    """Both legs of an impact, stacked, and whether each is the compression.

    They run through the same compiled solve.
    """

    def run(state: State, compressing: Flag) -> tuple[State, Leg]:
        leg = solve_leg(motion, state, compressing, options)
        # The event puts the velocity at the turn within its tolerance of zero: now it is zero.
        return leg.end._replace(u=jnp.zeros_like(leg.end.u)), leg

    flags = jnp.asarray([True, False])
    return jax.lax.scan(run, motion.start(), flags)[1], flags


def solve_event(motion: Motion, options: EventOptions) -> Scaled:
    """The outcome of one lane."""
    legs, flags = solve_legs(motion, options)
    turn, end = (jax.tree.map(operator.itemgetter(leg), legs.end) for leg in (0, 1))
    # Apart from the solve, so that it costs nothing where nobody asks for it.
    forces = jax.vmap(lambda leg, flag: largest_force(motion, leg, flag))(legs.path, flags)
    max_force = jnp.max(forces)
    max_indentation = turn.w**motion.order
    compression_time = turn.t
    converged = jnp.all(legs.arrived)
    settled = motion.settled(end)
    if motion.push is not None and not isinstance(motion.form, GeneralForm):
        # With strong damping the bodies creep to rest and never turn: no event will come, but the
        # end is known. Every form but the general one is xⁿ at rest.
        creeps = ~legs.arrived[0] & motion.held(turn)
        static = jnp.where(creeps, motion.push, 1) ** (1 / motion.n)
        max_indentation = jnp.where(creeps, static, max_indentation)
        max_force = jnp.where(creeps, jnp.maximum(max_force, motion.push), max_force)
        compression_time = jnp.where(creeps, jnp.inf, compression_time)
        converged, settled = converged | creeps, settled | creeps
    return Scaled(
        restitution=-motion.velocity(end),
        duration=end.t,
        compression_time=compression_time,
        max_indentation=max_indentation,
        max_force=max_force,
        converged=converged,
        settled=settled,
        steps=jnp.sum(legs.steps),
    )

"""The front door: one impact, from touch to separation."""

from __future__ import annotations

import diffrax
import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._contact import Contact
from .._laws import (
    AbstractHuntCrossley,
    AbstractLaw,
    AbstractOscillator,
    restitution_of,
)
from .._parameter import as_parameter, is_valid, sanitised
from ._form import AbstractForm, HuntCrossleyForm, OscillatorForm, closed_form
from ._front_door import SPEED, Problem, check_law, problem_of, reduced, sound, uniform
from ._methods import Options, choose, options_of, solve
from ._oscillator import restitution_of_oscillator
from ._result import Impact, Status


def impact(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    *,
    method: str = "auto",
    rtol: float | None = None,
    atol: float | None = None,
    steps: int | None = None,
    solver: diffrax.AbstractSolver | None = None,
    adjoint: diffrax.AbstractAdjoint | None = None,
    external_force: ArrayLike | None = None,
) -> Impact:
    """One impact of two bodies: m δ'' = -F(δ, δ') + external force, δ(0) = 0, δ'(0) = velocity.

    Arguments: the law; the contact; the closing `velocity` v0 in m/s, at least
    `VELOCITY_THRESHOLD`. All numbers in them broadcast. `external_force` in N, constant, positive
    when it pushes the bodies together (the weight of a falling ball).

    `method`: "exact", the closed form of the Hunt-Crossley family and of the oscillator laws
    (Kelvin-Voigt, Tsuji, Antypov-Elliott, Thornton, Jankowski); "event", an adaptive solve that
    ends with the contact, for every law and with an external force; "phase", `steps` fixed steps
    over the phase angle with an error estimate, for laws that follow the contact to δ = 0; "auto",
    the cheapest that is right: "exact" where there is a closed form, "event" elsewhere.
    `Impact.method` says which it was.

    `rtol`, `atol`: of the event solve, in scaled units, for the outcome (default 1e-9; 1e-5 in
    float32); for the phase method `rtol` is the estimated error above which a lane counts as not
    converged (default 1e-6, 1e-4). Take 1e-11 for derivatives. `steps`: the fixed steps of "phase"
    (default 32), the most steps of each half of "event" (default 256). `solver`, `adjoint`: diffrax
    objects for "event"; by default Dopri8, and sensitivities that serve both modes.

    Returns an `Impact` in the broadcast shape. Bad lanes are flagged in `.status`, their numbers
    NaN, their neighbours untouched. Raises ValueError for a Python scalar out of range, an exponent
    the law is not made for, or a method that cannot do what is asked.

    Source: the energy integral of Hunt & Crossley (1975), doi 10.1115/1.3423596, and the
    references of the laws.
    """
    problem = problem_of(law, contact, velocity, external_force)
    options = options_of(method, rtol, atol, steps, solver, adjoint)
    return _impact(problem, options)


@eqx.filter_jit
def _impact(problem: Problem, options: Options) -> Impact:
    lanes = reduced(problem)
    method = choose(options.method, lanes.form, lanes.push is not None)
    scaled = solve(lanes, method, options)
    shape = problem.shape
    scale = lanes.scale
    # Not of all: what nobody asks for must stay dead code. A force that is not finite shows itself.
    finite = jnp.isfinite(scaled.restitution + scaled.duration)
    solved = scaled.converged & finite
    status = jnp.where(scaled.settled, int(Status.SETTLED), int(Status.SEPARATED))
    status = jnp.where(solved, status, int(Status.NOT_CONVERGED))
    status = _fill(jnp.where(lanes.valid, status, int(Status.INVALID_INPUT)), shape)
    good = lanes.valid & solved

    def result(value: Float[Array, "..."], unit: Float[Array, "..."]) -> Float[Array, "..."]:
        # An infinite time stays out of the product: 0 times inf is no derivative of the unit.
        usable = good & jnp.isfinite(value)
        product = jnp.where(usable, value, 1) * unit
        return _fill(jnp.where(usable, product, jnp.where(good, value, jnp.nan)), shape)

    one = jnp.ones_like(scale.speed)
    restitution = jnp.where(scaled.settled, 0, scaled.restitution)
    return Impact(
        restitution=result(restitution, one),
        rebound_velocity=result(restitution, scale.speed),
        duration=result(jnp.where(scaled.settled, jnp.inf, scaled.duration), scale.time),
        compression_time=result(scaled.compression_time, scale.time),
        max_indentation=result(scaled.max_indentation, scale.length),
        max_force=result(scaled.max_force, scale.force),
        energy_loss=result((1 - restitution) * (1 + restitution), scale.energy),
        status=status,
        error_estimate=None
        if scaled.error_estimate is None
        else _fill(scaled.error_estimate, shape),
        steps=None if scaled.steps is None else _fill(scaled.steps, shape),
        method=method,
    )


def _fill(value: Array, shape: tuple[int, ...]) -> Array:
    return jnp.broadcast_to(value, shape)


def restitution(
    law: AbstractLaw,
    contact: Contact | None = None,
    velocity: ArrayLike | None = None,
    *,
    method: str = "auto",
) -> Float[Array, "..."]:
    """The restitution e a law delivers in a free impact, and nothing else: no time is computed.

    For the Hunt-Crossley family e solves `α(1+e) = ln[(1+α)/(1-αe)]`, whatever the exponent; for
    the oscillator laws it is elementary. `contact` and the closing `velocity` in m/s are needed
    only where e depends on them; other laws are solved with `impact`.

    Returns e in the broadcast shape, dimensionless, NaN in bad lanes. `method` as in `impact`.
    Raises ValueError for a Python scalar out of range or a missing argument. Inverse, for the exact
    law: `exact_damping_factor`. Source: see `impact`.
    """
    check_law(law)
    options = options_of(method, None, None, None, None, None)
    closed = isinstance(law, AbstractHuntCrossley | AbstractOscillator)
    if contact is not None and velocity is not None:
        return _restitution(problem_of(law, contact, velocity), options)
    if closed and method in ("auto", "exact"):
        speed = None if velocity is None else as_parameter(velocity, "velocity", SPEED)
        return _restitution_alone(*uniform((law, contact, speed)))
    missing = "contact" if contact is None else "velocity"
    raise ValueError(
        f"Argument `{missing}` is needed for `{type(law).__name__}` by method {method!r}, "
        "but is None."
    )


@eqx.filter_jit
def _restitution_alone(
    law: AbstractLaw, contact: Contact | None, velocity: Float[Array, "..."] | None
) -> Float[Array, "..."]:
    valid = is_valid(law)
    if contact is not None:
        valid, contact = valid & is_valid(contact), sanitised(contact)
    if velocity is not None:
        fast = SPEED.holds(velocity)
        valid, velocity = valid & fast, jnp.where(fast, velocity, SPEED.inside)
    form = closed_form(sanitised(law), contact, velocity)
    assert form is not None  # the caller has looked
    form, good = sound(form)
    return jnp.where(good & valid, _of_form(form), jnp.nan)


@eqx.filter_jit
def _restitution(problem: Problem, options: Options) -> Float[Array, "..."]:
    lanes = reduced(problem)
    if choose(options.method, lanes.form, pushed=False) != "exact":
        # Under this jit whatever else the solve computes is dead code, and removed.
        return _impact(problem, options).restitution
    return _fill(jnp.where(lanes.valid, _of_form(lanes.form), jnp.nan), problem.shape)


def _of_form(form: AbstractForm) -> Float[Array, "..."]:
    if isinstance(form, HuntCrossleyForm):
        return restitution_of(form.alpha)
    assert isinstance(form, OscillatorForm)
    return restitution_of_oscillator(form.zeta, form.ending)

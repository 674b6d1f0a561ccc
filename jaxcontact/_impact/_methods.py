"""Which ways lead to the outcome of an impact, and the cheapest right one."""

from __future__ import annotations

import diffrax
import equinox as eqx
import jax.numpy as jnp

from ._closed_form import solve_hunt_crossley
from ._event import EventOptions, solve_event
from ._form import AbstractForm, HuntCrossleyForm, OscillatorForm
from ._front_door import Reduced
from ._lanes import over_lanes
from ._oscillator import solve_oscillator
from ._phase import solve_phase
from ._scaled import Scaled
from ._sensitivity import with_sensitivity

METHODS = ("auto", "exact", "phase", "event")


class Options(eqx.Module):
    """How to solve; None stands for the default of the method."""

    method: str = eqx.field(static=True)
    rtol: float | None = eqx.field(static=True)
    atol: float | None = eqx.field(static=True)
    steps: int | None = eqx.field(static=True)
    solver: diffrax.AbstractSolver | None
    adjoint: diffrax.AbstractAdjoint | None


def options_of(
    method: str,
    rtol: float | None,
    atol: float | None,
    steps: int | None,
    solver: diffrax.AbstractSolver | None,
    adjoint: diffrax.AbstractAdjoint | None,
) -> Options:
    """The options, checked."""
    if method not in METHODS:
        raise ValueError(f"Argument `method` must be one of {METHODS}, but is {method!r}.")
    for name, tolerance in (("rtol", rtol), ("atol", atol)):
        if tolerance is not None and not 0 < tolerance < 1:
            raise ValueError(f"Argument `{name}` must be in (0, 1), but is {tolerance!r}.")
    if steps is not None and (not isinstance(steps, int) or steps < 2):
        raise ValueError(f"Argument `steps` must be a whole number above 1, but is {steps!r}.")
    if method == "phase" and steps is not None and steps % 2:
        raise ValueError(
            f"Argument `steps` must be even for the phase method, half for each way, "
            f"but is {steps!r}."
        )
    for name, value, kind in (
        ("solver", solver, diffrax.AbstractSolver),
        ("adjoint", adjoint, diffrax.AbstractAdjoint),
    ):
        if value is not None and not isinstance(value, kind):
            raise ValueError(
                f"Argument `{name}` must be a diffrax {kind.__name__}, but is {value!r}."
            )
    return Options(method, rtol, atol, steps, solver, adjoint)


def choose(method: str, form: AbstractForm, pushed: bool) -> str:
    """The method to use; ValueError if the one asked for cannot do it."""
    exact = isinstance(form, HuntCrossleyForm | OscillatorForm) and not pushed
    phase = (isinstance(form, HuntCrossleyForm) or form.tension) and not pushed
    if method == "auto":
        return "exact" if exact else "event"
    if method == "exact" and not exact:
        raise ValueError(
            "Argument `method` must be 'event', 'phase' or 'auto' here, but is 'exact': there is "
            "a closed form only for the Hunt-Crossley family and the oscillator laws, and without "
            "an external force."
        )
    if method == "phase" and not phase:
        raise ValueError(
            "Argument `method` must be 'event' or 'auto' here, but is 'phase': the phase angle "
            "follows a contact to δ = 0, without external force and without a clamped tension."
        )
    return method


def event_options(options: Options, double: bool) -> EventOptions:
    """Defaults: Dopri8, tolerance 1e-9 (1e-5 in float32, whose rounding allows no less)."""
    rtol = options.rtol if options.rtol is not None else (1e-9 if double else 1e-5)
    floor = 0.0 if double else 1e-5
    rtol = max(rtol, floor)
    atol = max(options.atol if options.atol is not None else rtol, floor)
    return EventOptions(
        solver=diffrax.Dopri8() if options.solver is None else options.solver,
        adjoint=diffrax.ForwardMode() if options.adjoint is None else options.adjoint,
        rtol=rtol,
        atol=atol,
        max_steps=256 if options.steps is None else options.steps,
    )


def solve(reduced: Reduced, method: str, options: Options) -> Scaled:
    """The scaled outcome of every different lane."""
    form = reduced.form
    double = reduced.scale.length.dtype == jnp.float64
    if method == "exact":
        if isinstance(form, HuntCrossleyForm):
            return solve_hunt_crossley(form.alpha, reduced.n)
        assert isinstance(form, OscillatorForm)
        return solve_oscillator(form.zeta, reduced.n, form.ending)
    if method == "phase":
        steps = 32 if options.steps is None else options.steps
        tolerance = options.rtol if options.rtol is not None else (1e-6 if double else 1e-4)
        return over_lanes(
            with_sensitivity(lambda motion: solve_phase(motion, steps, tolerance)),
            reduced.motion(),
        )
    how = event_options(options, double)

    def one_lane(motion):
        return solve_event(motion, how)

    # An adjoint of the user's speaks for itself.
    lane = one_lane if options.adjoint is not None else with_sensitivity(one_lane)
    return over_lanes(lane, reduced.motion())

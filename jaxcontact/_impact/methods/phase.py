"""The phase method: the phase angle is the independent variable, without events and branches.

Consider a free contact with a pushing force, and the polar angle ψ of the point (w, u). It
increases monotonically from 0 at touch over π/2 at the turn to π at separation. Integrating r, t
and τ over ψ with the same steps in every lane needs neither an event nor a step controller.
"""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from ..._forms import AbstractForm, Flag, ScaledImpact
from ..._functions import varying
from ..._solver import Moment
from ..._solver.runge_kutta import step_with_error, tableau
from ..derivatives import over_lanes, with_sensitivity
from ..front_door import Lanes
from ..motion.coordinates import Number, State
from ..motion.ends import Way
from ..motion.equation import Motion
from ..motion.errors import balance_of
from ..motion.peak import largest_force
from .method import AbstractMethod, count_field, tolerance_field


class Phase(AbstractMethod):
    """A number `steps` of fixed steps of order 8 over the phase angle, with an error estimate.

    It solves free impacts that last until δ = 0: the Hunt-Crossley family, and laws with tension.
    All lanes take the same steps, which suits GPUs.

    - `steps`: even, half of them for each way.
    - `tolerance`: a lane with a larger estimated relative error counts as not converged. Default:
      1e-6, and 1e-4 in float32.

    Raises ValueError for an option out of its range, for a clamped contact and with an external
    force. Source of the steps: Prince & Dormand (1981), doi 10.1016/0771-050X(81)90010-3.
    """

    steps: int = count_field("steps", 32)
    tolerance: float | None = tolerance_field("tolerance")
    name: ClassVar[str] = "phase"

    def __check_init__(self) -> None:
        if self.steps % 2:
            raise ValueError(
                "Argument `steps` must be even for the phase method, half for each way, "
                f"but is {self.steps!r}."
            )

    def chosen(self, form: AbstractForm, pushed: bool) -> Phase:
        """Return the method itself if the contact lasts until δ = 0."""
        if pushed or not form.follows_phase_angle:
            raise ValueError(
                "Argument `method` must be 'event' or 'auto' here, but is 'phase': the phase angle "
                "follows a contact to δ = 0, without external force and without a clamped tension."
            )
        return self

    def error(self, dtype: Any) -> float:
        """Return the tolerance of the error estimate."""
        return self.tolerance or (1e-6 if dtype == jnp.float64 else 1e-4)

    def solve(self, lanes: Lanes) -> ScaledImpact:
        """Return the outcome of every distinct lane."""
        tolerance = self.error(lanes.scale.length.dtype)
        solve = eqx.Partial(solve_phase, steps=self.steps, tolerance=tolerance)
        # All lanes take the same number of steps: none waits for another one.
        return over_lanes(with_sensitivity(solve, 1 << 12), lanes.motion())


class Polar(NamedTuple):
    """The variables integrated over the angle: r, time t, regularised time τ and lost energy."""

    radius: Number
    t: Number
    tau: Number
    loss: Number | None


def solve_phase(motion: Motion, steps: int, tolerance: float) -> ScaledImpact:
    """Return the outcome of one lane in an even number of `steps`.

    The error estimate compares the method of order 8 with the embedded one of order 7, summed over
    the steps. It therefore estimates the error of the less accurate one. Measured, it exceeds the
    error of the result by 10 to 14000 times while that error is below 1e-4. A lane counts as not
    converged if the angle turns back or the estimate exceeds `tolerance`.
    """
    start = motion.start()
    # The unit of w in the plane of the angle.
    unit = motion.form.phase_unit() * jnp.ones_like(start.w)
    width = np.pi / steps
    angles = (np.arange(steps)[:, None] + tableau().nodes) * width
    dtype = start.u.dtype
    sines, cosines = jnp.asarray(np.sin(angles), dtype), jnp.asarray(np.cos(angles), dtype)
    compressing = jnp.arange(steps) < steps // 2

    def in_plane(polar: Polar, sine: Number, cosine: Number) -> State:
        return State(unit * polar.radius * sine, polar.radius * cosine, polar.t, polar.loss)

    def advance(carry: tuple[Polar, tuple[Number, Number], Flag], at: tuple) -> tuple:
        polar, (radius_error, t_error), forward = carry
        sine, cosine, flag, always = at

        def rate(stage: int, polar: Polar) -> tuple[Polar, Flag]:
            s, c = sine[stage], cosine[stage]
            dw, du, clock, loss = motion.rate(in_plane(polar, s, c), flag)
            dx = dw / unit
            turning = c * dx - s * du
            slow = polar.radius / jnp.where(turning > 0, turning, 1)
            taken = None if loss is None else loss * slow
            change = Polar((s * dx + c * du) * slow, clock * slow, slow, taken)
            return change, turning > 0

        polar, step_error, good = step_with_error(rate, polar, width, always)
        radius_error += jnp.abs(step_error.radius / polar.radius)
        t_error += jnp.abs(step_error.t)
        return (polar, (radius_error, t_error), forward & good), (polar, t_error)

    zero = varying(unit, jnp.zeros_like(unit))
    touch = Polar(start.u, zero, zero, start.loss)
    # Not `jnp.ones`: the compiler must not know that all entries are true.
    always = jnp.arange(steps) >= 0
    (last, error, forward), (polars, t_errors) = jax.lax.scan(
        advance,
        (touch, (zero, zero), varying(unit, jnp.asarray(True))),
        (sines, cosines, compressing, always),
    )

    polars = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), touch, polars)
    nodes = np.arange(steps + 1) * width
    # At the ends and the turn the sine and cosine are exact numbers.
    sine, cosine = np.sin(nodes), np.cos(nodes)
    half = steps // 2
    sine[steps] = cosine[half] = 0
    states = in_plane(polars, jnp.asarray(sine, dtype), jnp.asarray(cosine, dtype))

    def peak(indices: Int[Array, " nodes"], flag: Flag, sign: int = 1) -> Number:
        part = jax.tree.map(lambda leaf: leaf[indices], states)
        return largest_force(Way(motion, flag), Moment(polars.tau[indices], part), sign)

    legs = jnp.asarray(np.arange(half + 1) + np.array([[0], [half]]))
    forces = jax.vmap(peak)(legs, jnp.array([True, False]))
    least = -jnp.maximum(peak(legs[1], jnp.asarray(False), -1), 0) if motion.may_pull else None
    # With strong damping the compression is much the shorter half.
    of_time = jnp.maximum(error[1] / last.t, t_errors[half - 1] / polars.t[half])
    estimate = jnp.maximum(error[0], of_time)
    end = jax.tree.map(lambda leaf: leaf[steps], states)
    max_indentation = motion.indentation(states.w[half])
    balance = balance_of(motion, end, max_indentation)
    return ScaledImpact(
        restitution=balance.restitution,
        duration=last.t,
        compression_time=polars.t[half],
        max_indentation=max_indentation,
        max_force=jnp.max(forces),
        converged=forward & (estimate <= tolerance) & (balance.error <= tolerance),
        settled=jnp.asarray(False),
        min_force=least,
        energy_loss=balance.energy_loss,
        error_estimate=estimate,
        steps=jnp.asarray(steps),
    )

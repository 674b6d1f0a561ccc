"""Solves up to an event, by diffrax and by SciPy, as a user writes them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import diffrax
import optimistix
from scipy.integrate import solve_ivp


def until(
    rate: Callable[..., Any],
    y: Any,
    ends: Any,
    rtol: Any,
    *,
    solver: diffrax.AbstractSolver | None = None,
    args: Any = None,
    start: Any = 0.0,
    stop: float = 1e3,
    first: float | None = 0.01,
    atol: float = 1e-3,
    longest: Any = None,
    direction: Any = False,
    newton: float = 1e-13,
    most: int = 100_000,
    proportional: float = 0.0,
    adjoint: diffrax.AbstractAdjoint | None = None,
) -> diffrax.Solution:
    """Solve by diffrax up to the first of the events `ends`; None: up to `stop`.

    `atol` in units of `rtol`, `first` and `longest` step; `newton` is the tolerance of an event.
    `proportional` is a part of the control of steps.
    """
    root = optimistix.Newton(newton, newton)
    control = {"pcoeff": proportional, "icoeff": 1.0 if proportional == 0 else 0.4}
    controller = diffrax.PIDController(rtol=rtol, atol=atol * rtol, dtmax=longest, **control)
    return diffrax.diffeqsolve(
        diffrax.ODETerm(rate),
        solver or diffrax.Dopri8(),
        start,
        stop,
        first,
        y,
        args=args,
        stepsize_controller=controller,
        event=None if ends is None else diffrax.Event(ends, root, direction=direction),
        adjoint=adjoint or diffrax.RecursiveCheckpointAdjoint(),
        max_steps=most,
        throw=False,
    )


def ending(function: Callable[..., float], direction: int = -1) -> Callable[..., float]:
    """An event of `solve_ivp` that ends the solve, where the function falls through 0 or rises."""
    function.terminal, function.direction = True, direction  # pyright: ignore[reportFunctionMemberAccess]
    return function


apart = ending(lambda t, y: y[0])


def contact(
    acceleration: Callable[[Any, Any], Any],
    rtol: float,
    *,
    method: str = "DOP853",
    speed: float = 1.0,
    stop: float = 1e3,
    atol: float = 1.0,
    first: float | None = 0.01,
    ends: Any = apart,
    **how: Any,
) -> Any:
    """Solve x'' = a(x, x') by SciPy from touch at a speed, until x is back at zero or `ends`.

    x is at least 0 in `acceleration`; `atol` in units of `rtol`.
    """

    def rate(t: float, y: Any) -> tuple[Any, Any]:
        x, v = y.tolist()
        return v, acceleration(max(x, 0.0), v)

    return solve_ivp(
        rate, (0, stop), (0, speed), method, events=ends, rtol=rtol, atol=atol * rtol,
        first_step=first, **how,
    )  # fmt: skip

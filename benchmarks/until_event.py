"""Solves up to an event, by diffrax and by SciPy, as a user writes them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import diffrax
import optimistix


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
) -> diffrax.Solution:
    """Solve by diffrax up to the first of the events `ends`; None: up to `stop`.

    `atol` in units of `rtol`, `first` and `longest` step; `newton` is the tolerance of an event.
    """
    root = optimistix.Newton(newton, newton)
    return diffrax.diffeqsolve(
        diffrax.ODETerm(rate),
        solver or diffrax.Dopri8(),
        start,
        stop,
        first,
        y,
        args=args,
        stepsize_controller=diffrax.PIDController(rtol=rtol, atol=atol * rtol, dtmax=longest),
        event=None if ends is None else diffrax.Event(ends, root, direction=direction),
        max_steps=most,
        throw=False,
    )


def ending(function: Callable[..., float], direction: int = -1) -> Callable[..., float]:
    """An event of `solve_ivp` that ends the solve, where the function falls through 0 or rises."""
    function.terminal, function.direction = True, direction  # pyright: ignore[reportFunctionMemberAccess]
    return function

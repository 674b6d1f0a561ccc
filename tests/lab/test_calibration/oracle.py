"""e(v) of the speed-dependent laws, and flights, by methods independent of the library."""

import functools
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from tests.oracle.stored import stored


def delivered(alpha: float) -> float:
    """e of a damping factor: the root of α(1+e) = ln[(1+α)/(1-αe)]."""
    if alpha == 0:
        return 1.0

    def balance(e):
        return alpha * (1 + e) - np.log1p(alpha) + np.log1p(-alpha * e)

    # e = 0 is always a root; the other lies above it and below 1/α, where the logarithm ends.
    return brentq(balance, 1e-6, min(1, 1 / alpha) * (1 - 1e-15), xtol=1e-15)


def constant_damping(b: float) -> Callable[[float], float]:
    """e(v) of F = K δⁿ (1 + b δ'), whose damping factor is b v."""
    return lambda v: delivered(b * v)


@stored()
def _viscous_restitution(strength: float) -> float:
    """e of x'' = -(x^1.5 + strength √x x'), x(0) = 0, x'(0) = 1, ended where x returns to 0."""

    def motion(t, state):
        root = np.sqrt(max(state[0], 0.0))
        return [state[1], -(root**3 + strength * root * state[1])]

    def end(t, state):
        return state[0] if t > 0.5 else 1.0

    end.direction, end.terminal = -1, True
    run = solve_ivp(
        motion, (0, 20), [0.0, 1.0], method="DOP853", rtol=1e-10, atol=1e-12, events=end
    )
    return -float(run.y_events[0][0][1])


@functools.cache
def _spline() -> CubicSpline:
    strengths = np.linspace(0.0, 0.45, 25)
    return CubicSpline(strengths, [_viscous_restitution(s) for s in strengths])


def kuwabara_kono(kappa: float) -> Callable[[float], float]:
    """e(v) for κ = A (K/m)^(2/5): one curve of 1.5 κ v^(1/5), integrated and interpolated."""

    def law(v: float) -> float:
        strength = 1.5 * kappa * v**0.2
        if not 0 <= strength <= 0.45:
            raise ValueError(f"Argument `v` must keep the strength in the table, but is {v!r}.")
        return float(_spline()(strength))

    return law


@stored()
def plastic(yield_speed: float, mass: float, stiffness: float, v: float):
    """e, contact time and peak force of Thornton's force over indentation, by integration."""
    at_yield = (1.25 * mass * yield_speed**2 / stiffness) ** 0.4
    force = stiffness * at_yield**1.5

    def loading(d: float) -> float:
        if d < at_yield:
            return stiffness * max(d, 0.0) ** 1.5
        return force + 1.5 * stiffness * np.sqrt(at_yield) * (d - at_yield)

    def ended(pull, state, end, span):
        end.terminal, end.direction = True, -1

        def motion(t, s):
            return [s[1], -pull(s[0]) / mass]

        return solve_ivp(
            motion, (0, span), state, events=end, rtol=1e-11, atol=1e-13, max_step=span / 50
        )

    span = 5 * (1.25 * mass * v**2 / stiffness) ** 0.4 / v + 5 * at_yield / yield_speed
    down = ended(loading, [0.0, v], lambda t, s: s[1], span)
    depth = float(down.y[0, -1])
    largest = loading(depth)
    # R* F_max = R F_e.
    stiffer = stiffness * np.sqrt(stiffness * depth**1.5 / largest)
    flat = depth - (largest / stiffer) ** (2 / 3)
    up = ended(
        lambda d: stiffer * max(d - flat, 0.0) ** 1.5,
        [depth, 0.0],
        lambda t, s: s[0] - flat if t > 0 else 1.0,
        span,
    )
    return -float(up.y[1, -1]) / v, float(down.t[-1] + up.t[-1]), largest

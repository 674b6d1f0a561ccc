"""The units of an impact and their derivatives, by hand, independent of the library.

`X = (m v²/K)^(1/(n+1))`, and an outcome Q(K, m, v, n; α) is `U q(α, n)` with U a product of powers
of K, m and v. So `dQ/dθ = U (q d ln U/dθ + dq/dθ)`.
"""

import numpy as np

QUANTITIES = ("e", "duration", "compression_time", "max_indentation", "max_force")

# The powers of X, m and v in the unit of each quantity.
POWERS = {
    "e": (0, 0, 0), "duration": (1, 0, -1), "compression_time": (1, 0, -1),
    "max_indentation": (1, 0, 0), "max_force": (-1, 1, 2), "energy_loss": (0, 1, 2),
}  # fmt: skip


def length(p) -> np.ndarray:
    """X in extended precision."""
    stiffness, mass, velocity, n = (np.longdouble(p[k]) for k in ("K", "m", "v", "n"))
    return (mass / stiffness * velocity**2) ** (1 / (n + 1))


def unit(quantity: str, p) -> np.ndarray:
    powers = POWERS[quantity]
    half = 0.5 if quantity == "energy_loss" else 1.0
    x, mass, velocity = length(p), np.longdouble(p["m"]), np.longdouble(p["v"])
    return half * x ** powers[0] * mass ** powers[1] * velocity ** powers[2]


def log_slope(quantity: str, by: str, p) -> np.ndarray:
    """d ln U/dθ."""
    in_x, in_m, in_v = POWERS[quantity]
    share = 1 / (p["n"] + 1)
    if by == "K":
        return -in_x * share / p["K"]
    if by == "m":
        return (in_x * share + in_m) / p["m"]
    if by == "v":
        return (2 * in_x * share + in_v) / p["v"]
    if by == "n":
        return -in_x * share * np.log(np.float64(length(p)))
    return 0.0 * p["K"]


def slope(quantity: str, by: str, p, q, own) -> np.ndarray:
    """dQ/dθ of the whole, from the scaled outcome and its own slopes, by α and n."""
    return np.float64(unit(quantity, p)) * (log_slope(quantity, by, p) * q + own.get(by, 0))


def natural(quantity: str, by: str, p) -> np.ndarray:
    """The unit of a derivative: that of the outcome over that of the parameter."""
    return np.float64(unit(quantity, p)) / (p[by] if by in "Kmv" else np.ones_like(p["K"]))

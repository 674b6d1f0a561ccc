"""The engines' contact forces, written from their documentation, independent of the library.

Each takes the parameters of an export and returns the acceleration of the ball: δ'' as a function
of δ, δ' and the closing speed.
"""

import math

import numpy as np

from benchmarks.until_event import apart, contact, ending

TSUJI = [4.8218, -18.022, 27.467, -22.348, 11.087, -4.2783, 1.2728]


def drake(p, mass, radius, sap=False):
    if sap:
        # Springs in series, whose relaxation times add.
        k, tau = p["point_contact_stiffness"] / 2, 2 * p["relaxation_time"]
        return lambda x, v, v0: -k * (x + tau * v) / mass
    k1 = k2 = p["point_contact_stiffness"]
    d1 = d2 = p["hunt_crossley_dissipation"]
    k = k1 * k2 / (k1 + k2)
    d = k2 / (k1 + k2) * d1 + k1 / (k1 + k2) * d2
    return lambda x, v, v0: -k * x * max(0, 1 + d * v) / mass


def adams(p, mass, radius):
    """IMPACT with x1 = 0, x = -δ: STEP(x, x1 - d, c_max, x1, 0) by the manual's cubic."""
    k, n, c_max, d = (p[x] for x in ("stiffness", "force_exponent", "damping", "penetration_depth"))

    def step(x, x0, h0, x1, h1):
        if x <= x0 or x >= x1:
            return h0 if x <= x0 else h1
        part = (x - x0) / (x1 - x0)
        return h0 + (h1 - h0) * part**2 * (3 - 2 * part)

    return lambda x, v, v0: -max(0, k * x**n - step(-x, -d, c_max, 0, 0) * -v) / mass


def simbody(p, mass, radius):
    k1 = k2 = p["stiffness"] ** (2 / 3)
    s = k2 / (k1 + k2)
    k, c = k1 * s, p["dissipation"] * s + p["dissipation"] * (1 - s)

    def force(x, v, v0):
        hertz = 4 / 3 * k * x * math.sqrt(radius * k * x)
        return -hertz * max(0, 1 + 1.5 * c * v) / mass

    return force


def exudyn(p, mass, radius, model=2):
    k, n = p["contactStiffness"], p["contactStiffnessExponent"]
    if model == 0:
        return lambda x, v, v0: -(k * x**n + p["contactDamping"] * v) / mass
    e = p["restitutionCoefficient"]
    if model == 1:
        scale = 1.5 * (1 - e)
    else:
        scale = 1.5 * (1 - e) * (11 - e) / (1 + 9 * e) if e > 1 / 3 else (1 - e * e) / e
    return lambda x, v, v0: -(k * x**n + scale * k / v0 * x**n * v) / mass


def lammps(p, mass, radius, damping="coeff_restitution"):
    if damping == "mass_velocity":
        return lambda x, v, v0: -(p["k_n"] * x + p["eta_n0"] * mass * v) / mass

    def force(x, v, v0):
        contact_radius = math.sqrt(radius * x)
        elastic = p["k_n"] * contact_radius * x
        if damping == "viscoelastic":
            eta = p["eta_n0"] * contact_radius * mass
        else:
            if damping in ("coeff_restitution", "limit_damping"):
                log = math.log(p["e"])
                factor = -math.sqrt(3 / 2) * 2 * math.sqrt(5 / 6) * log
                factor /= math.sqrt(math.pi**2 + log**2)
            else:
                factor = np.polyval(TSUJI, p["e"])
                factor *= math.sqrt(2) if damping == "tsuji_sqrt2" else 1
            eta = factor * math.sqrt(mass * elastic / x)
        return -(elastic + eta * v) / mass

    return force


def mujoco(p, mass, radius):
    # a + d (b v + k r) = (1 - d) a0 with a0 = 0 and r = -x, while positive.
    impedance = p["impedance"]
    b = p["damping"] / impedance
    k = p["stiffness"] * impedance / impedance**2
    return lambda x, v, v0: -impedance * (b * v + k * x)


def bullet(p, mass, radius):
    # Two equal bodies: springs in series, added dampings.
    k, c = p["contactStiffness"] / 2, 2 * p["contactDamping"]
    return lambda x, v, v0: -(k * x + c * v) / mass


def newton(p, mass, radius):
    # Two equal shapes: their means. The dashpot acts on approach.
    return lambda x, v, v0: -(p["ke"] * x + p["kd"] * max(v, 0)) / mass


def mercurydpm(p, mass, radius):
    return lambda x, v, v0: -(p["stiffness"] * x + p["dissipation"] * v) / mass


def yade(p, mass, radius):
    young = p["young"] / (2 * (1 - p["poisson"] ** 2))
    log = math.log(p["en"])
    alpha = -math.sqrt(5 / 6) * 2 * log / math.sqrt(log**2 + math.pi**2)
    alpha *= math.sqrt(2 * young * math.sqrt(radius))

    def force(x, v, v0):
        elastic = 4 / 3 * young * math.sqrt(radius) * x**1.5
        return -(elastic + alpha * math.sqrt(mass) * x**0.25 * v) / mass

    return force


def chrono(p, mass, radius):
    young = 1 / (2 * (1 - p["poisson_ratio"] ** 2) / p["young_modulus"])
    log = math.log(p["restitution"])
    beta = log / math.sqrt(log**2 + math.pi**2)

    def force(x, v, v0):
        sn = 2 * young * math.sqrt(radius * x)
        gn = -2 * math.sqrt(5 / 6) * beta * math.sqrt(sn * mass)
        return -(2 / 3 * sn * x + gn * v) / mass

    return force


def bounce(acceleration, velocity, duration, *, pulls, longest=3):
    """e and the duration by scipy; the contact ends at δ = 0, or where it would begin to pull."""

    def scaled(x, v):
        force = acceleration(max(x, 1e-300) * velocity * duration, v * velocity, velocity)
        return force * duration / velocity

    ends = apart if pulls else ending(lambda t, y: scaled(*y), 1)
    end = contact(scaled, 1e-11, atol=0.01, ends=ends, stop=longest)
    return -end.y_events[0][0, 1], end.t_events[0][0] * duration

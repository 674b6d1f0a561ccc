"""Friction laws beside the rebounds of Kharaz et al.: `python -m benchmarks oblique_rebounds`.

The table ships with the package (see jaxcontact/data/SOURCES.md). Nothing is fitted: μ is that of
the paper, β0 of Walton's law that of Foerster et al. (1994) for glass, κ that of the materials, and
e = 1. The result has by law the root mean square of the differences of v_t'/v_t and of the spin,
and the microseconds of an impact among 20,000. `returned` is u'/u0 at small angles of solid spheres
of like materials: for ν = 0, and the largest for ν up to 0.5.
"""

from __future__ import annotations

from importlib.resources import files
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from benchmarks.study import Study
from benchmarks.time_and_error.measure import timed

MU, RADIUS, SPEED = 0.092, 2.5e-3, 3.9
OXIDE = jc.Material(youngs_modulus=380e9, poisson_ratio=0.23, density=4000.0)
GLASS = jc.Material(youngs_modulus=70e9, poisson_ratio=0.25)
CONTACT = jc.Contact.sphere_plane(radius=RADIUS, sphere=OXIDE, plane=GLASS)
LAWS = {
    "rigid": jc.RigidCoulomb(mu=MU),
    "walton": jc.WaltonFriction(mu=MU, beta0=0.44),
    "regularized": jc.RegularizedCoulomb(mu=MU, v_d=0.01),
    "displacement": jc.SpringSlider(mu=MU, form="displacement"),
    "force": jc.SpringSlider(mu=MU, form="force"),
    "rescaled": jc.SpringSlider(mu=MU, form="rescaled"),
    "mbf": jc.MawBarberFawcett(mu=MU),
}
LANES = 20_000


class Points(NamedTuple):
    """Measured points: angles from the normal in degrees, and v_t'/v_t or spins in rad/s."""

    ratio_angle: np.ndarray
    ratio: np.ndarray
    spin_angle: np.ndarray
    spin: np.ndarray


def points() -> Points:
    """Return the points of the table that ships with the package."""
    with (files("jaxcontact.data") / "oblique_rebounds.csv").open() as table:
        angle, _, ratio, spin = np.genfromtxt(table, delimiter=",", skip_header=1).T
    has_ratio, has_spin = ~np.isnan(ratio), ~np.isnan(spin)
    return Points(angle[has_ratio], ratio[has_ratio], angle[has_spin], spin[has_spin])


@jax.jit
def rebound(friction: Any, degrees: Any) -> Any:
    """Return v_t'/v_t and the spin in rad/s, positive in the sense of rolling."""
    angle = jnp.radians(degrees)
    normal, along = SPEED * jnp.cos(angle), SPEED * jnp.sin(angle)
    how = {"friction": friction, "bodies": jc.RoundBodies(RADIUS)}
    hit = jc.oblique_impact(jc.Hertz(), CONTACT, normal, along, **how)
    assert hit.spin is not None
    return hit.tangential_velocity / along, -hit.spin[0]


@jax.jit
def returned(friction: Any, ratio: Any) -> Any:
    """Return u'/u0 at a small angle, by the stiffness ratio κ."""
    contact = jc.Contact(mass=1.0, stiffness=1.0, tangential_ratio=ratio)
    slip = jnp.full_like(ratio, 1e-7)
    return jc.oblique_impact(jc.Hertz(), contact, 1.0, slip, friction=friction).slip_velocity / slip


def of_law(friction: Any) -> dict[str, float]:
    """Return the differences from the points, and the time of an impact."""
    seen = points()
    angles = np.concatenate([seen.ratio_angle, seen.spin_angle])
    ratio, spin = rebound(friction, np.resize(angles, LANES))
    count = seen.ratio.size
    off = ratio[:count] - seen.ratio, spin[count : angles.size] - seen.spin
    rms, rms_spin = (float(np.sqrt(np.mean(np.square(x)))) for x in off)
    many = np.linspace(0.1, 60, LANES)
    spent, _ = timed(lambda: rebound(friction, many), True)
    return {"rms": rms, "rms_spin": rms_spin, "us": 1e6 * spent["seconds"] / LANES}


def measure(known: dict | None) -> dict[str, Any]:
    laws = {}
    for name, law in LAWS.items():
        laws[name] = of_law(law)
        print(name, laws[name], flush=True)
    nu = np.linspace(0, 0.5, 51)
    back = {}
    for name in ("displacement", "force", "rescaled", "mbf"):
        shares = np.asarray(returned(LAWS[name], 2 * (1 - nu) / (2 - nu)))
        back[name] = {"at_zero": float(shares[0]), "largest": float(shares.max())}
    return {"laws": laws, "returned": back}


STUDY = Study(__file__, __doc__, measure)

"""The numbers printed in the paper, with place and number of digits, and the computed numbers
beside them.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from .. import Contact, Material, get_law
from ..extend import markdown_table, rendered
from . import _ball, _impacts
from ._figures.impact_figures import fig4


class Published(NamedTuple):
    """One printed number; `half` is half a unit of its last digit (0: a formula's exact number).

    `differs` is the reason why the computed number differs, or empty if it agrees.
    """

    name: str
    where: str
    printed: str
    value: float
    half: float
    unit: str = ""
    differs: str = ""


_REGRESSION = (
    "the paper does not give the spacing of its points; the value lies in the band over samplings"
)

PUBLISHED = (
    Published(
        "stiffness of two steel spheres", "Eq. 2-3, sec. 4", "1.07e10", 1.07e10, 5e7, "N/m^1.5"
    ),
    Published(
        *("mass of the steel example", "sec. 4", "0.033", 0.033, 5e-4, "kg"),
        "0.033 kg is the mass of one sphere; the effective mass of the two spheres of K is half",
    ),
    Published("e of case 1", "sec. 4", "0.9", 0.9, 5e-2),
    Published("e of case 2", "sec. 4", "0.9", 0.9, 5e-2),
    Published(
        *("c of case 2 by Eq. 37 at e = 0.9", "sec. 4", "2.0e10", 2.0e10, 5e8, "N s/m^2.5"),
        "no law of Table 1 gives it: they give 1.52e10 to 1.90e10",
    ),
    Published("β of case 1", "Eq. 22", "2.408", 2.408, 5e-4, "", _REGRESSION),
    Published("β of case 2", "Eq. 22", "2.395", 2.395, 5e-4, "", _REGRESSION),
    Published("∫ u^1.5 √(1-u^2.5) du", "Eq. 27-28", "4/15", 4 / 15, 0.0),
    Published("α e/(1-e) of Hu-Guo", "Eq. 37, Table 1", "3/2", 1.5, 0.0),
    Published("α e/(1-e) of Flores et al.", "Table 1", "8/5", 1.6, 0.0),
    Published("α/(1-e²) of Lankarani-Nikravesh", "Table 1", "3/4", 0.75, 0.0),
    Published("α/(1-e) of Hunt-Crossley", "Table 1", "3/2", 1.5, 0.0),
    Published("speed at contact", "Eq. 41-42", "4.2", 4.2, 5e-2, "m/s"),
)

_DENSITY = 7850.0
"""Density of steel in kg/m³; the paper does not state it."""

_ROUNDING = 1e-13
"""Relative tolerance for numbers that are exact in the paper; measured 4e-16."""


class Number(NamedTuple):
    """A published number and the computed one."""

    published: Published
    ours: float

    @property
    def difference(self) -> float:
        """Computed minus published."""
        return self.ours - self.published.value

    @property
    def agrees(self) -> bool:
        """True if the computed number equals the published one to the printed digits."""
        allowed = self.published.half or _ROUNDING * abs(self.published.value)
        # Half a unit itself rounds to the printed digits, and a float may lie just beyond it.
        return abs(self.difference) <= allowed * (1 + 1e-9)


def numbers() -> tuple[Number, ...]:
    """Return every published number with the computed one, in the order of the paper."""
    ours = _ours()
    return tuple(Number(published, ours[published.name]) for published in PUBLISHED)


def markdown(table: tuple[Number, ...]) -> str:
    """Return published and computed numbers as a Markdown table; ValueError for anything else."""
    rows = table if isinstance(table, list | tuple) else [None]
    if not all(isinstance(row, Number) for row in rows):
        raise ValueError(
            f"Argument `table` must hold numbers as `numbers` gives them, but is {rendered(table)}."
        )
    header = ("number", "where", "published", "ours", "difference", "")
    rows = [
        (
            *(number.published.name, number.published.where),
            f"{number.published.printed} {number.published.unit}".rstrip(),
            *(f"{number.ours:.6g}", f"{number.difference:+.2g}"),
            "agrees" if number.agrees else number.published.differs,
        )
        for number in table
    ]
    return "\n".join(markdown_table(header, rows)) + "\n"


def _ours() -> dict[str, float]:
    steel = Material(*map(jnp.asarray, (_impacts.YOUNGS_MODULUS, _impacts.POISSON_RATIO, _DENSITY)))
    spheres = Contact.sphere_sphere(_impacts.RADIUS, _impacts.RADIUS, steel, steel)
    cases = _impacts.impacts()
    beta = fig4().tables["band"]["beta"]
    e = 0.5
    # α = (1-e)/e / (5/2 I): the integral by the family with the velocity profile of Eq. 24.
    integral = (1 - e) / e / (2.5 * float(get_law("energy_loss", e=e, beta=2.5).damping_factor()))
    second = _impacts.CASES[1]
    steel_case = Contact(mass=_impacts.MASS, stiffness=_impacts.STIFFNESS)
    alpha = float(get_law("hu_guo", e=0.9).damping_factor(steel_case, second.velocity))

    def factor(name: str, function: float) -> float:
        return float(get_law(name, e=e).damping_factor()) / function

    return {
        "stiffness of two steel spheres": float(spheres.stiffness),
        "mass of the steel example": float(spheres.mass),
        "e of case 1": float(cases.restitution[0]),
        "e of case 2": float(cases.restitution[1]),
        "c of case 2 by Eq. 37 at e = 0.9": alpha * _impacts.STIFFNESS / second.velocity,
        "β of case 1": float(beta[0]),
        "β of case 2": float(beta[1]),
        "∫ u^1.5 √(1-u^2.5) du": integral,
        "α e/(1-e) of Hu-Guo": factor("hu_guo", (1 - e) / e),
        "α e/(1-e) of Flores et al.": factor("flores", (1 - e) / e),
        "α/(1-e²) of Lankarani-Nikravesh": factor("lankarani_nikravesh", 1 - e * e),
        "α/(1-e) of Hunt-Crossley": factor("hunt_crossley", 1 - e),
        "speed at contact": _ball.SPEED,
    }

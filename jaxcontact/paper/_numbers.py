"""The numbers printed in the paper, with place and number of digits, and the computed numbers
beside them.
"""

from __future__ import annotations

from decimal import Decimal
from fractions import Fraction
from typing import NamedTuple

import jax.numpy as jnp

from .. import Contact, Material, get_law
from ..extend import refusal
from . import _ball, _impacts
from ._compression import fig4


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


def _printed(name: str, where: str, text: str, unit: str = "", differs: str = "") -> Published:
    if "/" in text:
        return Published(name, where, text, float(Fraction(text)), 0.0, unit, differs)
    last = int(Decimal(text).as_tuple().exponent)
    half = float(Decimal(5).scaleb(last - 1))
    return Published(name, where, text, float(text), half, unit, differs)


_REGRESSION = (
    "the paper does not give the spacing of its points; the value lies in the band over samplings"
)
_SPHERES = "0.033 kg is the mass of one sphere; the effective mass of the two spheres of K is half"
_NO_LAW = "no law of Table 1 gives it: they give 1.52e10 to 1.90e10"

PUBLISHED = (
    _printed("stiffness of two steel spheres", "Eq. 2-3, sec. 4", "1.07e10", "N/m^1.5"),
    _printed("mass of the steel example", "sec. 4", "0.033", "kg", _SPHERES),
    _printed("e of case 1", "sec. 4", "0.9"),
    _printed("e of case 2", "sec. 4", "0.9"),
    _printed("c of case 2 by Eq. 37 at e = 0.9", "sec. 4", "2.0e10", "N s/m^2.5", _NO_LAW),
    _printed("β of case 1", "Eq. 22", "2.408", "", _REGRESSION),
    _printed("β of case 2", "Eq. 22", "2.395", "", _REGRESSION),
    _printed("∫ u^1.5 √(1-u^2.5) du", "Eq. 27-28", "4/15"),
    _printed("α e/(1-e) of Hu-Guo", "Eq. 37, Table 1", "3/2"),
    _printed("α e/(1-e) of Flores et al.", "Table 1", "8/5"),
    _printed("α/(1-e²) of Lankarani-Nikravesh", "Table 1", "3/4"),
    _printed("α/(1-e) of Hunt-Crossley", "Table 1", "3/2"),
    _printed("speed at contact", "Eq. 41-42", "4.2", "m/s"),
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
    return tuple(map(Number, PUBLISHED, _ours()))


def markdown(table: tuple[Number, ...]) -> str:
    """Return published and computed numbers as a Markdown table; ValueError for anything else."""
    given = table if isinstance(table, list | tuple) else [None]
    if not all(isinstance(row, Number) for row in given):
        raise refusal("table", "hold numbers as `numbers` gives them", table)
    lines = ["| number | where | published | ours | difference | |", "|---|---|---|---|---|---|"]
    for one in table:
        known = one.published
        cells = known.name, known.where, f"{known.printed} {known.unit}".rstrip()
        cells += f"{one.ours:.6g}", f"{one.difference:+.2g}"
        lines.append(f"| {' | '.join(cells)} | {'agrees' if one.agrees else known.differs} |")
    return "\n".join(lines) + "\n"


def _ours() -> tuple[float, ...]:
    """Return the computed numbers, in the order of `PUBLISHED`."""
    steel = Material(*map(jnp.asarray, (_impacts.YOUNGS_MODULUS, _impacts.POISSON_RATIO, _DENSITY)))
    spheres = Contact.sphere_sphere(_impacts.RADIUS, _impacts.RADIUS, steel, steel)
    mass, stiffness, speed = _impacts.MASS, _impacts.STIFFNESS, _impacts.CASES[1].velocity

    def alpha(name: str, e: float = 0.5, **more: float) -> float:
        law = get_law(name, e=e, **more)
        return float(law.damping_factor(Contact(mass, stiffness), speed))

    e = 0.5
    return (
        *(float(spheres.stiffness), float(spheres.mass)),
        *map(float, _impacts.impacts().restitution),
        alpha("hu_guo", 0.9) * stiffness / speed,
        *map(float, fig4().tables["band"]["beta"]),
        # α = (1-e)/e / (5/2 I): the integral by the family with the velocity profile of Eq. 24.
        (1 - e) / e / (2.5 * alpha("energy_loss", beta=2.5)),
        *(alpha("hu_guo") / ((1 - e) / e), alpha("flores") / ((1 - e) / e)),
        *(alpha("lankarani_nikravesh") / (1 - e * e), alpha("hunt_crossley") / (1 - e)),
        _ball.SPEED,
    )

"""The numbers printed in the paper, with place and number of digits."""

from __future__ import annotations

from typing import NamedTuple


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

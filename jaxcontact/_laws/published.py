"""Published formulas α(e) for the Hunt-Crossley family; most deliver a different e."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._entry import RESTITUTION_FROM_ZERO, parameter
from .._forms import Lane
from .hunt_crossley import AbstractOfRestitution
from .registry import register_law


@register_law(
    "hunt_crossley",
    formula="3(1-e)/2",
    source="Hunt & Crossley 1975, doi 10.1115/1.3423596",
    valid="e near 1",
)
class HuntCrossley(AbstractOfRestitution):
    """α = 3(1-e)/2, the small-loss damping of Hunt and Crossley.

    `e` in [0, 1]; the law delivers this e only near 1. Raises ValueError for a Python scalar out of
    range. Source: Hunt & Crossley (1975), J. Appl. Mech. 42:440, doi 10.1115/1.3423596.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION_FROM_ZERO)

    def _alpha_of(self, e: Lane) -> Lane:
        return 1.5 * (1 - e)


@register_law(
    "lankarani_nikravesh",
    formula="3(1-e²)/4",
    source="Lankarani & Nikravesh 1990, doi 10.1115/1.2912617",
    valid="e > 0.7",
)
class LankaraniNikravesh(AbstractOfRestitution):
    """α = 3(1-e²)/4, from the energy loss of an elastic indentation.

    `e` in [0, 1]; accurate for e > 0.7. Raises ValueError for a Python scalar out of range. Source:
    Lankarani & Nikravesh (1990), J. Mech. Des. 112:369, doi 10.1115/1.2912617.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION_FROM_ZERO)

    def _alpha_of(self, e: Lane) -> Lane:
        return 0.75 * (1 - e) * (1 + e)


@register_law(
    "flores",
    formula="8(1-e)/(5e)",
    source="Flores et al. 2011, doi 10.1007/s11044-010-9237-4",
    valid="claimed for e > 0.1; -6 % at e = 0.5, -31 % at 0.1",
)
class Flores(AbstractOfRestitution):
    """α = 8(1-e)/(5e), with separate losses for compression and restitution.

    `e` in (0, 1]; the law delivers less than e, by 6 % at 0.5. Raises ValueError for a Python
    scalar out of range. Source: Flores et al. (2011), Multibody Syst. Dyn. 25:357, doi
    10.1007/s11044-010-9237-4; the same formula in Ye, Li & Zhu (2009), Earthquake Eng. Struct. Dyn.
    38:1135.
    """

    def _alpha_of(self, e: Lane) -> Lane:
        return 1.6 * (1 - e) / e


@register_law(
    "hu_guo",
    formula="3(1-e)/(2e)",
    source="Hu & Guo 2015, doi 10.1007/s11044-015-9453-z",
    valid="e > 0.5 within 3 %",
)
class HuGuo(AbstractOfRestitution):
    """α = 3(1-e)/(2e), from the velocity profile of an elastic indentation in both phases.

    `e` in (0, 1]; the law delivers e within 3 % above 0.5. Raises ValueError for a Python scalar
    out of range. Source: Hu & Guo (2015), Multibody Syst. Dyn., doi 10.1007/s11044-015-9453-z.
    """

    def _alpha_of(self, e: Lane) -> Lane:
        return 1.5 * (1 - e) / e


@register_law(
    "gonthier",
    formula="(1-e²)/e",
    source="Gonthier et al. 2004, doi 10.1023/B:MUBO.0000029392.21648.bc",
    valid="all e; furthest off near 1, exact as e → 0",
)
class Gonthier(AbstractOfRestitution):
    """α = (1-e²)/e, a simple fit to the implicit relation between α and e.

    `e` in (0, 1]; exact as e → 0, a third too strong as e → 1. Raises ValueError for a Python
    scalar out of range. Source: Gonthier et al. (2004), Multibody Syst. Dyn. 11:209, doi
    10.1023/B:MUBO.0000029392.21648.bc.
    """

    def _alpha_of(self, e: Lane) -> Lane:
        return (1 - e) * (1 + e) / e


@register_law(
    "carvalho_martins",
    formula="3(1-e)(11-e)/(2(1+9e))",
    source="Carvalho & Martins 2019, doi 10.1016/j.mechmachtheory.2019.04.018",
    valid="within 0.05 % for e > 0.49, 0.8 % at 1/3",
)
class CarvalhoMartins(AbstractOfRestitution):
    """α = 3(1-e)(11-e)/(2(1+9e)), a rational fit to the exact relation.

    `e` in [0, 1]; the law delivers e within 0.05 % above 0.49. Raises ValueError for a Python
    scalar out of range. Source: Carvalho & Martins (2019), Mech. Mach. Theory, doi
    10.1016/j.mechmachtheory.2019.04.018.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION_FROM_ZERO)

    def _alpha_of(self, e: Lane) -> Lane:
        return 1.5 * (1 - e) * (11 - e) / (1 + 9 * e)


@register_law(
    "herbert_mcwhannell",
    formula="6(1-e)/((2e-1)²+3)",
    source="Herbert & McWhannell 1977, doi 10.1115/1.3439270",
    valid="e > 0.8",
)
class HerbertMcWhannell(AbstractOfRestitution):
    """α = 6(1-e)/((2e-1)²+3).

    `e` in [0, 1]; accurate for e > 0.8. Raises ValueError for a Python scalar out of range. Source:
    Herbert & McWhannell (1977), J. Eng. Ind. 99:513, doi 10.1115/1.3439270.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION_FROM_ZERO)

    def _alpha_of(self, e: Lane) -> Lane:
        return 6 * (1 - e) / (jnp.square(2 * e - 1) + 3)


@register_law(
    "zhiying_qishao",
    formula="3(1-e²)/4 · exp(2(1-e))",
    source="Zhiying & Qishao 2006, J. Dyn. Control 4:294",
    valid="e > 0.4",
)
class ZhiyingQishao(AbstractOfRestitution):
    """α = (3/4)(1-e²) exp(2(1-e)), the law of Lankarani and Nikravesh corrected for strong damping.

    `e` in [0, 1]; accurate for e > 0.4. Raises ValueError for a Python scalar out of range. Source:
    Zhiying & Qishao (2006), J. Dyn. Control 4:294, as quoted in later reviews.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION_FROM_ZERO)

    def _alpha_of(self, e: Lane) -> Lane:
        return 0.75 * (1 - e) * (1 + e) * jnp.exp(2 * (1 - e))


@register_law(
    "lee_wang",
    formula="3(1-e)/4",
    source="Lee & Wang 1983, J. Mech. Trans. Autom. Des. 105:534",
    valid="half the small-loss damping: delivers (1+e)/2 near 1",
)
class LeeWang(AbstractOfRestitution):
    """α = 3(1-e)/4, half the damping that a small loss requires.

    `e` in [0, 1]; near 1 the law delivers (1+e)/2. Raises ValueError for a Python scalar out of
    range. Source: Lee & Wang (1983), J. Mech. Trans. Autom. Des. 105:534.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION_FROM_ZERO)

    def _alpha_of(self, e: Lane) -> Lane:
        return 0.75 * (1 - e)

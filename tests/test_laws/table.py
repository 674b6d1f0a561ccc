"""Every registered law a second time: its force in mpmath, and its parameters.

A damping factor (family F = K d^n (1 + alpha v/v0)) or a damping term (all other laws) is a
function of mpmath numbers, transcribed from the publications and not from the library.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from fractions import Fraction

import mpmath as mp

import jaxcontact as jc

THRESHOLD = mp.sqrt(mp.ldexp(1, -1022))


def of(text: str) -> mp.mpf:
    """A number as a publication prints it."""
    fraction = Fraction(text)
    return mp.mpf(fraction.numerator) / fraction.denominator


def kept(function):
    """Keep what a search or a quadrature found, by its arguments and the digits of the time."""

    @functools.cache
    def at(digits, *numbers):
        return function(*numbers)

    return functools.wraps(function)(lambda *numbers: at(mp.mp.dps, *numbers))


@kept
def exact_alpha(e):
    """alpha (1 + e) = ln((1 + alpha)/(1 - alpha e)) by bisection, away from the root alpha = 0."""
    if e == 1:
        return mp.mpf(0)
    with mp.workdps(mp.mp.dps + 20):
        low, high = mp.mpf(1 - e) / 2, 1 / e

        def surplus(a):
            return a * (1 + e) - mp.log1p(a) + mp.log1p(-a * e)

        # Positive below the root, minus infinity at 1/e. Close to 1/e the logarithm is used.
        if e < mp.mpf("0.05"):
            alpha = high
            for _ in range(60):
                alpha = -mp.expm1(mp.log1p(alpha) - alpha * (1 + e)) / e
            return alpha
        for _ in range(int(3.4 * mp.mp.dps)):
            middle = (low + high) / 2
            low, high = (middle, high) if surplus(middle) > 0 else (low, middle)
        return (low + high) / 2


@kept
def energy_loss_alpha(e, beta, n="1.5"):
    """The loss integral by quadrature, not by the beta function."""
    n = mp.mpf(n)
    integral = mp.quad(lambda u: u**n * mp.sqrt(1 - u**beta), [0, 0.5, 1])
    return (1 - e) / e / ((n + 1) * integral)


def zeta_of_half_period(e):
    return -mp.log(e) / mp.sqrt(mp.pi**2 + mp.log(e) ** 2)


@kept
def clamped_zeta(e):
    """ln e = -zeta atan2(2 zeta w, 2 zeta^2 - 1)/w, and its continuation beyond zeta = 1."""
    if e == 1:
        return mp.mpf(0)

    def decrement(zeta):
        if zeta < 1:
            w = mp.sqrt(1 - zeta**2)
            return zeta * mp.atan2(2 * zeta * w, 2 * zeta**2 - 1) / w
        w = mp.sqrt(zeta**2 - 1)
        return zeta * mp.log((zeta + w) / (zeta - w)) / w

    low, high = mp.mpf(0), 10 / e
    with mp.workdps(mp.mp.dps + 20):
        for _ in range(int(4 * mp.mp.dps)):
            middle = (low + high) / 2
            low, high = (middle, high) if decrement(middle) < -mp.log(e) else (low, middle)
    return low


def tsuji(e):
    text = "1.2728 -4.2783 11.087 -22.348 27.467 -18.022 4.8218"
    return mp.sqrt(2) * sum(of(c) * e**i for i, c in enumerate(text.split()))


def thornton(e):
    text = (
        "-6.918798 -16.41105 146.8049 -796.4559 2928.711 -7206.864 11494.29 -11342.18 6276.757 "
        "-1489.915"
    )
    power = sum(of(h) * e ** (i + 1) for i, h in enumerate(text.split()))
    return mp.sqrt(1 / (1 - (1 + e) ** 2 * mp.exp(power)) - 1)


def jankowski(e):
    return 9 * mp.sqrt(5) / 2 * (1 - e**2) / (e * (e * (9 * mp.pi - 16) + 16))


def yielding(d, v, K, m, yields, c=0):
    """Hertz's force up to the indentation with the energy m v_y²/2, and its tangent beyond."""
    first = mp.power(of("5/4") * m * yields**2 / K, of("2/5"))
    elastic = K * mp.power(min(d, first), "1.5")
    force = elastic + of("3/2") * K * mp.sqrt(first) * max(d - first, mp.mpf(0))
    return force * (1 + c / K * v)


def jkr(d, v, K, m, pull_off):
    """The contact of the radius a with z = a²/R = q⁴, beyond the snap of its neck none."""
    length = mp.sqrt(pull_off / K)
    if d < -mp.cbrt(length / 3) * length:
        return mp.mpf(0)
    if length == 0:
        return K * mp.power(d, "1.5")
    high = mp.root(abs(d), 4) + mp.cbrt(of("4/3") * length)
    q = mp.findroot(lambda q: q**4 - of("4/3") * length * q - d, high)
    return K * (q**6 - 2 * length * q**3)


@dataclasses.dataclass(frozen=True)
class Law:
    """What a test needs to know of a law.

    `alpha(*parameters, K, v0)` for the family; `damping(d, v, K, m, *parameters)`, the force beside
    K d^n, or `loading`, the whole force, for the others. `parameters` are three sets of numbers,
    the last at the edge where the contact is elastic (for Tsuji nearly so); `from_zero`: e = 0 is
    allowed.
    """

    cls: type[jc.AbstractLaw]
    parameters: tuple[tuple[float, ...], ...] = ((0.85,), (0.4,), (1.0,))
    alpha: Callable | None = None
    damping: Callable | None = None
    loading: Callable | None = None
    names: tuple[str, ...] = ("e",)
    exponent: float = 1.5
    pulls: bool = False
    options: tuple[tuple[str, bool], ...] = ()
    from_zero: bool = False

    def make(self, *parameters, **options):
        return self.cls(**dict(zip(self.names, parameters, strict=True)), **dict(self.options))

    def force(self, d, v, K, m, v0, *parameters):
        """The force in mpmath."""
        if d < 0 and not self.cls.ends_apart:
            return mp.mpf(0)
        elastic = K * mp.power(d, self.exponent)
        if self.loading is not None:
            force = self.loading(d, v, K, m, *parameters)
        elif self.alpha is not None:
            speed = max(v0, THRESHOLD)
            force = elastic * (1 + self.alpha(*parameters, K, speed) / speed * v)
        else:
            force = elastic + self.damping(d, v, K, m, *parameters)
        return force if self.pulls else max(force, mp.mpf(0))


def kelvin_voigt(zeta):
    return lambda d, v, K, m, e: 2 * zeta(e) * mp.sqrt(K * m) * v


def root_quarter(a):
    return lambda d, v, K, m, e: a(e) * mp.sqrt(m * K) * mp.power(d, "0.25") * v


def jankowski_term(d, v, K, m, e):
    return 2 * jankowski(e) * mp.sqrt(m * K * mp.sqrt(d)) * v if v > 0 else mp.mpf(0)


def impact_function(d, v, K, m, c_max, depth):
    """Adams' STEP as its manual defines it, from x1 - d to x1 with the values c_max and 0."""
    if d >= depth:
        return c_max * v
    place = (depth - d) / depth  # (x - x0)/(x1 - x0) with x = x1 - delta
    return (c_max + (0 - c_max) * place**2 * (3 - 2 * place)) * v


def antypov_elliott(e):
    return mp.sqrt(5) * zeta_of_half_period(e)


LAWS = {
    "hertz": Law(jc.Hertz, ((), (), ()), alpha=lambda K, v: mp.mpf(0), names=()),
    "damped": Law(jc.Damped, ((0.7,), (30.0,), (0.0,)), alpha=lambda a, K, v: a, names=("alpha",)),
    "constant_damping": Law(
        jc.ConstantDamping, ((4e7,), (5e8,), (0.0,)), alpha=lambda c, K, v: c * v / K, names=("c",)
    ),
    "power_damping": Law(
        jc.PowerDamping,
        ((4e7, -0.9, 1.5), (5e8, 0.3, 0.2), (0.0, 0.0, 1.0)),
        alpha=lambda c, p, reference, K, v: c * (v / reference) ** p * v / K,
        names=("c", "power", "reference"),
    ),
    "marhefka_orin": Law(
        jc.MarhefkaOrin,
        ((0.1,), (0.6,), (0.0,)),
        alpha=lambda a, K, v: of("3/2") * a * v,
        names=("a",),
    ),
    "energy_loss": Law(
        jc.EnergyLoss,
        ((0.85, 2.2), (0.4, 3.5), (1.0, 2.0)),
        alpha=lambda e, beta, K, v: energy_loss_alpha(e, beta),
        names=("e", "beta"),
    ),
    "exact": Law(jc.ExactRestitution, alpha=lambda e, K, v: exact_alpha(e)),
    "hunt_crossley": Law(
        jc.HuntCrossley, alpha=lambda e, K, v: of("3/2") * (1 - e), from_zero=True
    ),
    "lankarani_nikravesh": Law(
        jc.LankaraniNikravesh, alpha=lambda e, K, v: of("3/4") * (1 - e**2), from_zero=True
    ),
    "flores": Law(jc.Flores, alpha=lambda e, K, v: of("8/5") * (1 - e) / e),
    "hu_guo": Law(jc.HuGuo, alpha=lambda e, K, v: of("3/2") * (1 - e) / e),
    "gonthier": Law(jc.Gonthier, alpha=lambda e, K, v: (1 - e**2) / e),
    "carvalho_martins": Law(
        jc.CarvalhoMartins,
        alpha=lambda e, K, v: 3 * (1 - e) * (11 - e) / (2 * (1 + 9 * e)),
        from_zero=True,
    ),
    "herbert_mcwhannell": Law(
        jc.HerbertMcWhannell,
        alpha=lambda e, K, v: 6 * (1 - e) / ((2 * e - 1) ** 2 + 3),
        from_zero=True,
    ),
    "zhiying_qishao": Law(
        jc.ZhiyingQishao,
        alpha=lambda e, K, v: of("3/4") * (1 - e**2) * mp.exp(2 * (1 - e)),
        from_zero=True,
    ),
    "lee_wang": Law(jc.LeeWang, alpha=lambda e, K, v: of("3/4") * (1 - e), from_zero=True),
    "kelvin_voigt": Law(
        jc.KelvinVoigt, damping=kelvin_voigt(zeta_of_half_period), exponent=1.0, pulls=True
    ),
    "antypov_elliott": Law(jc.AntypovElliott, damping=root_quarter(antypov_elliott), pulls=True),
    "tsuji": Law(jc.Tsuji, damping=root_quarter(tsuji), pulls=True, from_zero=True),
    "thornton": Law(
        jc.Thornton,
        damping=lambda d, v, K, m, e: 2 * thornton(e) * mp.sqrt(1.5 * m * K * mp.sqrt(d)) * v,
    ),
    "jankowski": Law(jc.Jankowski, damping=jankowski_term),
    "thornton_plastic": Law(
        jc.ThorntonPlastic, ((0.02,), (1e-3,), (1e3,)), loading=yielding, names=("yield_speed",)
    ),
    "viscoplastic": Law(
        jc.Viscoplastic,
        ((0.02, 4e7), (1e-3, 5e8), (1e3, 0.0)),
        loading=yielding,
        names=("yield_speed", "c"),
    ),
    "dmt": Law(
        jc.DMT,
        ((3.0,), (200.0,), (0.0,)),
        loading=lambda d, v, K, m, pull_off: K * mp.power(d, "1.5") - pull_off,
        names=("pull_off",),
        pulls=True,
    ),
    "jkr": Law(jc.JKR, ((3.0,), (200.0,), (0.0,)), loading=jkr, names=("pull_off",), pulls=True),
    "walton_braun": Law(
        jc.WaltonBraun,
        ((1.5, 2e3), (1.0, 4e4), (1.0, 0.0)),
        loading=lambda d, v, K, m, ratio, slope: K * d,
        names=("ratio", "slope"),
        exponent=1.0,
    ),
    # Without `largest`, its force is that of loading.
    "luding": Law(
        jc.Luding,
        ((1.5, 2e3, 0.3), (1.0, 4e4, 1.0), (1.0, 0.0, 0.0)),
        loading=lambda d, v, K, m, ratio, slope, adhesion: K * d,
        names=("ratio", "slope", "adhesion"),
        exponent=1.0,
    ),
    "power_restitution": Law(
        jc.PowerRestitution,
        ((0.1, 0.25, 1.5), (0.5, 0.1, 5.0), (0.0, 0.0, 1.0)),
        alpha=lambda b, p, reference, K, v: exact_alpha(1 - b * (v / reference) ** p),
        names=("loss", "power", "reference"),
    ),
    "bridges": Law(
        jc.Bridges,
        ((0.6, 0.25, 1.5), (0.4, 0.1, 5.0), (3.0, 0.1, 1.0)),
        alpha=lambda a, p, reference, K, v: exact_alpha(min(mp.mpf(1), a * (v / reference) ** -p)),
        names=("a", "power", "reference"),
    ),
    "wet_restitution": Law(
        jc.WetRestitution,
        ((0.85, 1e-3), (0.4, 0.5), (1.0, 0.0)),
        # A force that delivers .001 has the place of those that deliver less.
        alpha=lambda e, v_c, K, v: exact_alpha(max(e * (1 - v_c / v), mp.mpf(1e-3))),
        names=("e", "critical_speed"),
    ),
    "linear_dashpot": Law(
        jc.LinearDashpot,
        ((50.0,), (2e3,), (0.0,)),
        damping=lambda d, v, K, m, c: c * v,
        names=("c",),
    ),
    "step_damping": Law(
        jc.StepDamping,
        ((700.0, 1e-3), (5e3, 2e-4), (0.0, 1e-3)),
        damping=impact_function,
        names=("c_max", "d"),
    ),
    "kuwabara_kono": Law(
        jc.KuwabaraKono,
        ((2e-4,), (5e-3,), (0.0,)),
        damping=lambda d, v, K, m, A: of("3/2") * A * K * mp.sqrt(d) * v,
        names=("A",),
        pulls=True,
    ),
}

CLAMPED = {
    f"{name} without tension": dataclasses.replace(
        LAWS[name], pulls=False, options=(("tension", False),)
    )
    for name in ("antypov_elliott", "tsuji", "kuwabara_kono")
} | {
    "kelvin_voigt without tension": dataclasses.replace(
        LAWS["kelvin_voigt"],
        damping=kelvin_voigt(clamped_zeta),
        pulls=False,
        options=(("tension", False),),
    )
}

PULLING = {
    f"{name} with tension": dataclasses.replace(
        LAWS[name], pulls=True, options=(("tension", True),)
    )
    for name in (
        *("hu_guo", "exact", "thornton", "constant_damping"),
        *("linear_dashpot", "step_damping"),
    )
}

VARIANTS = LAWS | CLAMPED | PULLING

FAMILY = [name for name, law in LAWS.items() if law.alpha is not None]
ALPHA_OF_E = [name for name in FAMILY if LAWS[name].names == ("e",)]

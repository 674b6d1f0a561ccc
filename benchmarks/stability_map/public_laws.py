"""Every law of the registry by its own class, compared with the oracles of the map.

The parameters of each law are converted here again, from its publication, to a damping number of
one of the map's kinds. The oracles use that number, the package the law.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy.special import beta as beta_function

import jaxcontact as jc

from .collocation import EXTENDED, Array
from .grid import MASS, SPEED, STIFFNESS, STRONGEST_PUSH, Job, Lanes, in_units, outcomes, units_of
from .verdict import judge, record

LANES = 512
"""Of a law, free or pushed."""
_LARGEST = "largest error, times allowed"
_TSUJI = (4.8218, -18.022, 27.467, -22.348, 11.087, -4.2783, 1.2728)
_THORNTON = (
    *(-1489.915, 6276.757, -11342.18, 11494.29, -7206.864),
    *(2928.711, -796.4559, 146.8049, -16.41105, -6.918798, 0.0),
)


@dataclass
class Setting:
    """What lanes are about, in extended precision: SI, the exponent, and random numbers."""

    mass: Array
    stiffness: Array
    speed: Array
    n: float
    random: np.random.Generator

    @property
    def time(self) -> Array:
        """X/v0."""
        square = self.mass * self.speed**2 / self.stiffness
        return square ** (1 / EXTENDED(self.n + 1)) / self.speed

    def between(self, low: float, high: float) -> Array:
        """Double numbers, evenly in the logarithm."""
        return np.exp(self.random.uniform(np.log(low), np.log(high), self.mass.size))


Made = tuple[dict[str, Array], Array]
"""The arguments of a law, and the damping number that they mean."""


def _by_e(factor: Callable[[Array], Array], least: float) -> Callable[[Setting], Made]:
    def make(at: Setting) -> Made:
        e = at.random.uniform(least, 1, at.mass.size)
        return {"e": e}, factor(e.astype(EXTENDED))

    return make


def _constant(at: Setting) -> Made:
    c = at.between(1e-6, 10) * np.asarray(at.stiffness / at.speed, float)
    return {"c": c}, c * at.speed / at.stiffness


def _by_power(at: Setting) -> Made:
    c = at.between(1e-6, 10) * np.asarray(at.stiffness / at.speed, float)
    power, reference = at.random.uniform(-1, 1, c.size), at.between(0.1, 10)
    factor = (at.speed / reference) ** power.astype(EXTENDED)
    given = {"c": c, "power": power, "reference": reference}
    return given, c * factor * at.speed / at.stiffness


def _alpha_of(e: Array) -> Array:
    """α(1+e) = ln((1+α)/(1-αe)) by bisection, in a variable that ends where the logarithm does."""
    low, high = np.zeros_like(e), np.ones_like(e)
    for _ in range(70):
        share = (low + high) / 2
        alpha = share / e
        above = np.log1p(alpha) - np.log1p(-share) > alpha * (1 + e)
        low, high = np.where(above, low, share), np.where(above, share, high)
    return np.where(e == 1, 0, (low + high) / 2 / e)


def _by_loss(at: Setting) -> Made:
    e, power = at.random.uniform(0.05, 1, at.mass.size), at.random.uniform(-1, 1, at.mass.size)
    reference = at.between(0.1, 10)
    factor = (at.speed / reference) ** power.astype(EXTENDED)
    loss = np.asarray((1 - e) / factor, float)
    given = {"loss": loss, "power": power, "reference": reference}
    return given, _alpha_of(1 - loss * factor)


def _bridges(at: Setting) -> Made:
    power, reference = at.random.uniform(0, 1, at.mass.size), at.between(0.1, 10)
    factor = (at.speed / reference) ** -power.astype(EXTENDED)
    # One in ten is elastic.
    a = np.asarray(at.random.uniform(0.05, 1.1, at.mass.size) / factor, float)
    given = {"a": a, "power": power, "reference": reference}
    return given, _alpha_of(np.minimum(a * factor, 1))


def _wet(at: Setting) -> Made:
    delivered, share = (at.random.uniform(*of, at.mass.size) for of in ((0.05, 1), (0, 1)))
    e = delivered ** (1 - share)
    critical = np.asarray(at.speed * (1 - delivered / e), float)
    return {"e": e, "critical_speed": critical}, _alpha_of(e * (1 - critical / at.speed))


def _by_coefficient(at: Setting) -> Made:
    root = np.sqrt(at.stiffness * at.mass)
    c = at.between(1e-6, 10) * np.asarray(root, float)
    return {"c": c}, c / root / 2


def _without_memory(at: Setting) -> Made:
    a = at.between(1e-6, 1) / np.asarray(at.speed, float)
    return {"a": a}, EXTENDED(1.5) * a * at.speed


def _by_profile(at: Setting) -> Made:
    e, beta = at.random.uniform(0.05, 1, at.mass.size), at.random.uniform(1, 4, at.mass.size)
    integral = beta_function((at.n + 1) / beta, 1.5) / beta
    return {"e": e, "beta": beta}, (1 - e) / EXTENDED(1) / e / ((at.n + 1) * integral)


def _exact(at: Setting) -> Made:
    e = at.random.uniform(0.05, 1, at.mass.size)
    return {"e": e}, _alpha_of(e.astype(EXTENDED))


def _viscoelastic(at: Setting) -> Made:
    time = at.between(1e-6, 10) * np.asarray(at.time, float)
    return {"A": time}, time / at.time


def _ratio(e: Array) -> Array:
    """Kelvin and Voigt's damping ratio: -ln e/√(π² + ln² e)."""
    log = np.log(e)
    return -log / np.sqrt((4 * np.arctan(EXTENDED(1))) ** 2 + log**2)


def _clamped_ratio(e: Array) -> Array:
    """The ratio of Kelvin and Voigt's contact without tension, by bisection."""
    low, high = np.zeros_like(e), np.full_like(e, 100)
    for _ in range(75):
        z = (low + high) / 2
        # Each formula receives numbers of its own range.
        below, above = np.where(z < 1, z, 0), np.where(z > 1, z, 2)
        under = np.arccos(below) / np.sqrt((1 - below) * (1 + below))
        root = np.sqrt((above - 1) * (above + 1))
        over = np.log(above + root) / root
        loss = 2 * z * np.where(z < 1, under, np.where(z > 1, over, 1))
        weak = -loss > np.log(e)
        low, high = np.where(weak, z, low), np.where(weak, high, z)
    return (low + high) / 2


def _thornton(e: Array) -> Array:
    inside = np.square(1 + e) * np.exp(np.polyval(np.array(_THORNTON, EXTENDED), e))
    return 2 * np.sqrt(EXTENDED(1.5)) * np.sqrt(1 / (1 - inside) - 1) / np.sqrt(EXTENDED(5))


def _jankowski(e: Array) -> Array:
    pi = 4 * np.arctan(EXTENDED(1))
    ratio = 9 * np.sqrt(EXTENDED(5)) / 2 * (1 - e) * (1 + e) / (e * (e * (9 * pi - 16) + 16))
    return 2 * ratio / np.sqrt(EXTENDED(5))


@dataclass(frozen=True)
class Published:
    """A law, the family of its force, and its damping number by its parameters.

    `pulls`: whether it may, by default.
    """

    name: str
    family: str
    make: Callable[[Setting], Made]
    pulls: bool = False
    n: float = 1.5


def _family(name: str, factor: Callable[[Array], Array], least: float = 0.05) -> Published:
    return Published(name, "hunt_crossley", _by_e(factor, least))


LAWS = (
    Published("hertz", "hunt_crossley", lambda at: ({}, np.zeros_like(at.mass))),
    Published(
        "damped",
        "hunt_crossley",
        lambda at: ((a := {"alpha": at.between(1e-6, 10)}), a["alpha"].astype(EXTENDED)),
    ),
    Published("constant_damping", "hunt_crossley", _constant),
    Published("marhefka_orin", "hunt_crossley", _without_memory),
    Published("energy_loss", "hunt_crossley", _by_profile),
    Published("exact", "hunt_crossley", _exact),
    Published("power_damping", "hunt_crossley", _by_power),
    Published("power_restitution", "hunt_crossley", _by_loss),
    Published("bridges", "hunt_crossley", _bridges),
    Published("wet_restitution", "hunt_crossley", _wet),
    _family("hunt_crossley", lambda e: 3 * (1 - e) / 2),
    _family("lankarani_nikravesh", lambda e: 3 * (1 - e) * (1 + e) / 4),
    _family("flores", lambda e: 8 * (1 - e) / (5 * e)),
    _family("hu_guo", lambda e: 3 * (1 - e) / (2 * e)),
    _family("gonthier", lambda e: (1 - e) * (1 + e) / e),
    _family("carvalho_martins", lambda e: 3 * (1 - e) * (11 - e) / (2 * (1 + 9 * e))),
    _family("herbert_mcwhannell", lambda e: 6 * (1 - e) / (np.square(2 * e - 1) + 3)),
    _family("zhiying_qishao", lambda e: 3 * (1 - e) * (1 + e) / 4 * np.exp(2 * (1 - e))),
    _family("lee_wang", lambda e: 3 * (1 - e) / 4),
    Published("kelvin_voigt", "oscillator", _by_e(_ratio, 0.05), pulls=True, n=1.0),
    Published("linear_dashpot", "oscillator", _by_coefficient, n=1.0),
    Published("antypov_elliott", "oscillator", _by_e(_ratio, 0.05), pulls=True),
    Published(
        "tsuji",
        "oscillator",
        _by_e(lambda e: np.polyval(np.array(_TSUJI, EXTENDED), e) * np.sqrt(EXTENDED(0.4)), 0.1),
        pulls=True,
    ),
    # With tension it never ends below 0.14.
    Published("thornton", "oscillator", _by_e(_thornton, 0.15)),
    Published("jankowski", "oscillator_approach", _by_e(_jankowski, 0.05), pulls=True),
    Published("kuwabara_kono", "kuwabara_kono", _viscoelastic, pulls=True),
)


@dataclass(frozen=True)
class Question:
    """A law by its name, free or pushed, with tension or without.

    It goes to another process, which the functions of a `Published` cannot.
    """

    title: str
    tension: bool
    pushed: bool
    lanes: int
    seed: int = 0

    @property
    def law(self) -> Published:
        return next(law for law in LAWS if law.name == self.title)

    @property
    def name(self) -> str:
        tension = "" if self.tension == self.law.pulls else f", tension={self.tension}"
        return f"{self.law.name}{tension}, {'pushed' if self.pushed else 'free'}"


def law_jobs(lanes: int = LANES) -> list[Question]:
    """Every law as it is by default, free and pushed; where tension is a choice, both ways."""
    questions = []
    for law in LAWS:
        # Jankowski's force ends with the approach, and never pulls.
        both = law.name != "jankowski"
        for tension in {law.pulls, not law.pulls} if both else {law.pulls}:
            questions += [Question(law.name, tension, pushed, lanes) for pushed in (False, True)]
    return questions


def run_law(question: Question) -> dict[str, Any]:
    """The counts of a law's lanes, and the worst ones."""
    law, count = question.law, question.lanes
    random = np.random.default_rng(zlib.crc32(question.name.encode()) + question.seed)

    def logarithmic(low: float, high: float) -> Array:
        return np.exp(random.uniform(np.log(low), np.log(high), count))

    mass, stiffness, speed = (logarithmic(*of) for of in (MASS, STIFFNESS, SPEED))
    at = Setting(*(x.astype(EXTENDED) for x in (mass, stiffness, speed)), law.n, random)
    arguments, damping = law.make(at)
    if law.name == "kelvin_voigt" and not question.tension:
        damping = _clamped_ratio(arguments["e"].astype(EXTENDED))
    push = np.zeros(count)
    if question.pushed:
        push = logarithmic(1e-12, STRONGEST_PUSH) * random.choice([-1, 1], count)
    lanes = Lanes(damping, np.full(count, law.n), push, mass, stiffness, speed)
    unit = units_of(lanes)
    force = np.asarray(push * unit.force, float)
    given = {name: jnp.asarray(values) for name, values in arguments.items()}
    hit = jc.impact(
        jc.get_law(law.name, **given, tension=question.tension),
        jc.Contact(jnp.asarray(mass), jnp.asarray(stiffness), law.n),
        jnp.asarray(speed),
        external_force=jnp.asarray(force) if question.pushed else None,
    )
    got = in_units(outcomes(hit), unit)
    # All forms except that of Kuwabara and Kono have closed forms for free impacts.
    closed = not question.pushed and law.family != "kuwabara_kono"
    kind = _kind(question)
    job = Job(kind, law.n, question.pushed, "exact" if closed else "event", "float64", count)
    numbers = (damping, lanes.n.astype(EXTENDED), force.astype(EXTENDED) / unit.force)
    found = record(job, numbers, judge(job, numbers, np.asarray(hit.status), got))
    # This number of lanes is too small for a picture.
    return {name: found[name] for name in ("lanes", "counts", "worst", _LARGEST)}


def _kind(question: Question) -> str:
    """The map's kind of the force that the law has."""
    family = question.law.family
    if family == "hunt_crossley":
        # It never pulls in a free impact.
        return "hunt_crossley_tension" if question.tension and question.pushed else family
    if family == "oscillator_approach" or question.tension:
        return family
    return f"{family}_clamped"

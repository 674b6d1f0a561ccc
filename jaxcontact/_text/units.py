"""The words and the SI unit of every quantity, by its name as a field or an argument."""

from __future__ import annotations

import dataclasses
import math
import re
from typing import NamedTuple

_MEANING = {
    "restitution": ("restitution", ""),
    "rebound_velocity": ("rebound velocity", "m/s"),
    "duration": ("duration of contact", "s"),
    "compression_time": ("time to the largest indentation", "s"),
    "max_indentation": ("largest indentation", "m"),
    "max_force": ("largest force", "N"),
    "min_force": ("least force", "N"),
    "energy_loss": ("energy lost", "J"),
    "error_estimate": ("estimated relative error", ""),
    "steps": ("accepted steps", ""),
    "status": ("status", ""),
    "tangential_velocity": ("tangential velocity of the centres", "m/s"),
    "slip_velocity": ("slip velocity of the contact point", "m/s"),
    "impulse_ratio": ("impulse ratio", ""),
    **dict.fromkeys(("sliding_loss", "damping_loss", "spring_energy"), ("energy", "J")),
    "spin": ("spin", "rad/s"),
    "mu": ("friction coefficient μ", ""),
    "v_d": ("speed of the ramp", "m/s"),
    "e": ("restitution asked for", ""),
    "alpha": ("damping factor α", ""),
    "beta": ("damping exponent β", ""),
    "c": ("damping constant c", ""),
    "A": ("material time A", "s"),
    **dict.fromkeys(("n", "exponent"), ("exponent n", "")),
    **dict.fromkeys(("v", "v0", "velocity", "impact_velocity"), ("closing speed", "m/s")),
    **dict.fromkeys(("m", "mass"), ("effective mass", "kg")),
    **dict.fromkeys(("K", "stiffness"), ("contact stiffness", "N/m^n")),
    **dict.fromkeys(("R", "radius"), ("radius", "m")),
    "youngs_modulus": ("Young's modulus", "Pa"),
    "poisson_ratio": ("Poisson's ratio", ""),
    "density": ("density", "kg/m^3"),
    "height": ("height", "m"),
    "gravity": ("gravity", "m/s^2"),
    "external_force": ("external force", "N"),
    "time": ("time", "s"),
    "time_step": ("time step", "s"),
    "indentation": ("indentation", "m"),
    "position": ("position", "m"),
    "force": ("force", "N"),
    "energy": ("energy", "J"),
    "drop_height": ("drop height", "m"),
    "at_rest": ("whether the ball came to rest", ""),
    "rest_time": ("time when rest begins", "s"),
    "return_time": ("time until the ball is back at its height of touch", "s"),
    "margin": ("distance of a speed from another number of bounces", "m/s"),
    "rest_velocity": ("speed below which a touch counts as rest", "m/s"),
    "rest_indentation": ("indentation at rest", "m"),
    "remaining_flight": ("flight after the last touch listed", "s"),
}


def meaning(name: str) -> tuple[str, str]:
    """Return the words and the unit of a name; the name itself and "" if it is unknown."""
    return _MEANING.get(name, (name, ""))


def quantity(name: str, number: str) -> str:
    """Return a number with the unit of `name`: "4.2 m/s"."""
    return f"{number} {meaning(name)[1]}".rstrip()


def label(name: str, words: str | None = None, *, prefix: str = "", unit: str | None = None) -> str:
    """Return the label of a figure's axis: "closing speed / (m/s)".

    `words` and `unit` replace those of the table; `prefix` is that of the unit, "m" for milli.
    """
    quantity_words, usual = meaning(name)
    words, unit = quantity_words if words is None else words, usual if unit is None else unit
    if not unit:
        return words
    return f"{words} / ({prefix}{unit})" if "/" in unit else f"{words} / {prefix}{unit}"


class Shown(NamedTuple):
    """The presentation of a number of a prediction: its quantity, and `words`.

    By default the words are those of the quantity. `logarithm`: the prediction is its logarithm. A
    prediction may have `shown`, a mapping: "x" for its variable, the name of each column, and ""
    for a single one.
    """

    name: str
    words: str | None = None
    logarithm: bool = False


@dataclasses.dataclass(frozen=True)
class Unit:
    """A written unit: what it measures, and the conversion SI = number · times / by."""

    written: str
    si: str
    times: float = 1.0
    by: float = 1.0

    @property
    def converts(self) -> bool:
        """True if numbers change in the conversion to SI."""
        return self.times != self.by

    def to_si(self, number: float) -> float:
        """Return the number in SI units; rounded once if `times` or `by` is 1."""
        return number * self.times / self.by

    @property
    def words(self) -> str:
        """The conversion of a number in words: "/ 1000"."""
        return " ".join(
            [f"* {self.times:g}"] * (self.times != 1) + [f"/ {self.by:g}"] * (self.by != 1)
        )


_WRITTEN: dict[str, dict[str, tuple[float, float]]] = {
    "s": {
        "s sec secs second seconds": (1, 1),
        "ms msec milliseconds": (1, 1e3),
        "us µs μs usec microseconds": (1, 1e6),
        "ns": (1, 1e9),
        "min minutes": (60, 1),
    },
    "m": {
        "m meter meters metre metres": (1, 1),
        "dm": (1, 10),
        "cm centimeters centimetres": (1, 100),
        "mm millimeters millimetres": (1, 1e3),
        "um µm μm": (1, 1e6),
        "km": (1e3, 1),
        "in inch inches": (0.0254, 1),
        "ft feet": (0.3048, 1),
    },
    "px": {"px pix pixel pixels": (1, 1)},
    "m/s": {
        "m/s mps ms-1 ms^-1 m*s^-1 m·s-1 m·s^-1 m·s⁻¹ ms⁻¹ m.s-1": (1, 1),
        "cm/s cms-1": (1, 100),
        "mm/s mms-1": (1, 1e3),
        "um/s µm/s μm/s": (1, 1e6),
        "km/h kmh km/hr kph": (1, 3.6),
        "ft/s fps": (0.3048, 1),
        "in/s": (0.0254, 1),
        "mph": (0.44704, 1),
    },
    "rad": {"rad radian radians": (1, 1), "deg degree degrees °": (math.pi, 180)},
    "rad/s": {
        "rad/s rads-1 rad·s-1 rad·s⁻¹ rad.s-1 radians/s": (1, 1),
        "deg/s °/s degrees/s": (math.pi, 180),
        "rpm 1/min": (2 * math.pi, 60),
        "rev/s rps": (2 * math.pi, 1),
    },
    "": {"- 1 none": (1, 1), "% percent pct": (1, 100)},
    "m/s^2": {
        "m/s^2 m/s2 m/s² m/s/s m/s**2 ms-2 ms^-2 ms⁻² m·s-2 m·s^-2 m·s⁻² m.s-2 m*s^-2": (1, 1),
        "g gn g0": (9.80665, 1),
    },
    "N": {
        "N newton newtons": (1, 1),
        "kN": (1e3, 1),
        "mN": (1, 1e3),
        "lbf": (4.4482216152605, 1),
        "kgf kp": (9.80665, 1),
    },
}
"""By SI unit: the written units that are converted to it, and the factors."""

_BY_WORD = {
    word: (si, times, by)
    for si, groups in _WRITTEN.items()
    for words, (times, by) in groups.items()
    for word in words.split()
}
# mN is not MN; other units are recognised in any case.
_ANY_CASE = {word.casefold(): found for word, found in _BY_WORD.items() if found[0] != "N"}

_CLOCK = re.compile(r"(h+:)?(m|mm|min):(s|ss|sec)([.,](s+|c+|0+|f+|x+|ms))?")
"""The form of times such as 01:02.50, which may be written in place of a unit."""


def written_unit(text: str) -> Unit | None:
    """Return the unit of a text such as "mm/s" or "[ms]"; None if it is unknown."""
    plain = text.strip().strip("[](){}").strip()
    word = plain.replace(" ", "")
    entry = _BY_WORD.get(word) or _ANY_CASE.get(word.casefold())
    if entry is None and _CLOCK.fullmatch(word.casefold()):
        entry = "s", 1.0, 1.0  # such cells are read in seconds
    return None if entry is None else Unit(plain, *entry)

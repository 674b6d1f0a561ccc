"""The words and the SI unit of every quantity, by the name it has as a field or an argument."""

from __future__ import annotations

_MEANING = {
    "restitution": ("restitution", ""),
    "rebound_velocity": ("rebound velocity", "m/s"),
    "duration": ("duration of contact", "s"),
    "compression_time": ("time to the largest indentation", "s"),
    "max_indentation": ("largest indentation", "m"),
    "max_force": ("largest force", "N"),
    "energy_loss": ("energy lost", "J"),
    "error_estimate": ("estimated relative error", ""),
    "steps": ("accepted steps", ""),
    "status": ("status", ""),
    "e": ("restitution asked for", ""),
    "alpha": ("damping factor α", ""),
    "beta": ("damping exponent β", ""),
    "c": ("damping constant c", ""),
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
    "force": ("force", "N"),
    "energy": ("energy", "J"),
    "drop_height": ("drop height", "m"),
    "rest_time": ("time when rest begins", "s"),
    "rest_velocity": ("speed below which a touch counts as rest", "m/s"),
    "rest_indentation": ("indentation at rest", "m"),
    "remaining_flight": ("flight after the last touch listed", "s"),
}


def meaning(name: str) -> tuple[str, str]:
    """What a name stands for, and its unit; the name itself and "" if the name is not known."""
    return _MEANING.get(name, (name, ""))


def quantity(name: str, number: str) -> str:
    """A number with the unit of `name`: "4.2 m/s"."""
    return f"{number} {meaning(name)[1]}".rstrip()


def label(name: str, words: str | None = None, *, prefix: str = "") -> str:
    """The label of a figure's axis: "closing speed / (m/s)".

    `words` replace those of the table; `prefix` is that of the unit, "m" for milli.
    """
    known, unit = meaning(name)
    words = known if words is None else words
    if not unit:
        return words
    return f"{words} / ({prefix}{unit})" if "/" in unit else f"{words} / {prefix}{unit}"

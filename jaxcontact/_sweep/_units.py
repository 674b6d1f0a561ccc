"""What the usual names of axes and fields mean, and their SI units."""

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
    "n": ("exponent n", ""),
    "exponent": ("exponent n", ""),
    "v": ("closing speed", "m/s"),
    "v0": ("closing speed", "m/s"),
    "velocity": ("closing speed", "m/s"),
    "impact_velocity": ("closing speed", "m/s"),
    "m": ("effective mass", "kg"),
    "mass": ("effective mass", "kg"),
    "K": ("contact stiffness", "N/m^n"),
    "stiffness": ("contact stiffness", "N/m^n"),
    "R": ("radius", "m"),
    "radius": ("radius", "m"),
    "youngs_modulus": ("Young's modulus", "Pa"),
    "poisson_ratio": ("Poisson's ratio", ""),
    "density": ("density", "kg/m^3"),
    "height": ("height", "m"),
    "gravity": ("gravity", "m/s^2"),
    "external_force": ("external force", "N"),
    "time": ("time", "s"),
}


def meaning(name: str) -> tuple[str, str]:
    """What a name stands for, and its unit, empty if it has none or is not known."""
    return _MEANING.get(name, (name, ""))


def label(name: str) -> str:
    """A name for the axis of a figure: "closing speed / (m/s)"."""
    words, unit = meaning(name)
    if not unit:
        return words
    return f"{words} / ({unit})" if "/" in unit else f"{words} / {unit}"

"""Arguments that do not exist."""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from .choices import did_you_mean

Given = ParamSpec("Given")
Returned = TypeVar("Returned")

_NOT_MODELLED = {
    r"frict|^mu(_|$)|tangen|rolling": "friction is `friction=` of a `Scene`, a `System` "
    "or `oblique_impact`, such as `RigidCoulomb(mu=0.3)`",
    r"spin|rotat|angular|omega|orient|torque|inertia": "spheres of a scene with friction turn: "
    "`Sphere(spin=..., inertia=...)`",
    r"drag|^air|wind|magnus|viscosity|fluid": "flights are in vacuum here (`calibrate` and "
    "`fit_bounces` have `drag`)",
    r"adhes|cohes|surface_energy|sticki": "bodies do not stick together (yet)",
    r"^e$|restitution|damping": "it belongs to a law, such as `ExactRestitution(e=0.8)`",
}
"""The reason why an argument of such a name does not exist."""

_ELSEWHERE = {
    "position": (
        r"^[qxy]_?0?$|^initial",
        "a mechanism starts with `position=` and `velocity=`",
    ),
    "velocity": (r"^v_0$|^[qx]?dot|^qd|^qvel", "a mechanism starts with `velocity=`"),
    "times": (
        r"^ts?$|t_?eval|save_?at",
        "`times=` are those of the states, and `run.at` returns the states at any others",
    ),
}
"""The names of arguments in other libraries, by the name here, and what it is."""


def not_modelled(name: str) -> str | None:
    """Return the reason why an argument of this name does not exist; None for other names."""
    found = (why for pattern, why in _NOT_MODELLED.items() if re.search(pattern, name.casefold()))
    return next(found, None)


def refuses_unknown(function: Callable[Given, Returned]) -> Callable[Given, Returned]:
    """Make a function explain in a TypeError why it lacks an argument; its signature stays.

    Python raises TypeError for an unknown argument too.
    """
    known = [name for name in inspect.signature(function).parameters if name != "self"]
    owner = function.__qualname__.removesuffix(".__init__")

    @functools.wraps(function)
    def called(*args: Given.args, **given: Given.kwargs) -> Returned:
        for name in given:
            if name not in known:
                other = (
                    why
                    for here, (pattern, why) in _ELSEWHERE.items()
                    if here in known and re.search(pattern, name.casefold())
                )
                why = not_modelled(name) or next(other, None)
                hint = f": {why}." if why else f".{did_you_mean(name, known)}"
                raise TypeError(f"`{owner}` has no argument `{name}`{hint}")
        return function(*args, **given)

    return called

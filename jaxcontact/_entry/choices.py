"""Flags, names and objects on entry, arguments that do not exist, and values as messages
show them.
"""

from __future__ import annotations

import difflib
import functools
import inspect
import os
import pathlib
import re
from collections.abc import Callable, Iterable
from typing import Any, ParamSpec, TypeGuard, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

_LONG, _BEGINNING = 300, 100
"""Characters: longer values are shown by their beginning, type and shape."""


def rendered(value: Any) -> str:
    """Return a value as a message shows it; long ones are cut after their beginning."""
    kind = type(value).__name__
    try:
        text = repr(value)
    except Exception:  # a foreign repr may raise anything, as that of 10**4300 does
        return f"an object of type `{kind}`"
    if len(text) <= _LONG:
        return text
    shape = getattr(value, "shape", None)
    more = f" and shape {shape}" if isinstance(shape, tuple) else ""
    return f"{text[:_BEGINNING]}... (of type `{kind}`{more})"


def refusal(name: str, must: str, value: Any, more: str = "") -> ValueError:
    """Return the error of an argument: what it must be, what it is, and `more`."""
    return ValueError(f"Argument `{name}` must {must}, but is {rendered(value)}.{more}")


def traced(*trees: Any) -> bool:
    """Return whether trees hold a traced number."""
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(trees))


def is_list(value: Any) -> TypeGuard[list | tuple]:
    """Return whether a value is a list or a tuple."""
    return isinstance(value, list | tuple)


def shown(value: Any) -> str:
    """Return a number in readable form; arrays shortened, traced values by their type."""
    if not eqx.is_array(value) or traced(value):
        return eqx.tree_pformat(value)
    if value.ndim == 0:
        return f"{value.item():.9g}"
    return np.array2string(np.asarray(value), precision=6, separator=", ", threshold=6)


Kind = TypeVar("Kind")


def as_flag(value: Any) -> bool | None:
    """Convert a Python, NumPy or JAX flag to True or False; None for anything else."""
    if isinstance(value, np.ndarray | np.generic | jax.Array):
        plain = not isinstance(value, Tracer | np.ma.MaskedArray) and value.ndim == 0
        value = value.item() if plain and value.dtype == bool else None
    return value if isinstance(value, bool) else None


def require_flag(name: str, value: Any) -> bool:
    """Convert a flag to True or False; ValueError for anything else."""
    flag = as_flag(value)
    if flag is None:
        raise refusal(name, "be True or False", value)
    return flag


def require_choice(name: str, value: Any, choices: Iterable[str]) -> str:
    """Return `value` if it is one of a few names; otherwise ValueError lists them."""
    known = tuple(choices)
    if not isinstance(value, str) or value not in known:
        raise refusal(
            name, f"be one of {', '.join(map(repr, known))}", value, did_you_mean(value, known)
        )
    return value


def nearest(given: Any, known: Iterable[str]) -> str | None:
    """Return the known name that is most similar to a misspelt one; None without a close match."""
    if not isinstance(given, str):
        return None
    folded = {name.casefold(): name for name in known}
    found = difflib.get_close_matches(given.casefold(), folded, n=1)
    return folded[found[0]] if found else None


def did_you_mean(given: Any, known: Iterable[str]) -> str:
    """Return a suggestion for the end of a message, with a leading blank; "" without a match."""
    near = nearest(given, known)
    return f" Did you mean {near!r}?" if near else ""


def require_kind(name: str, value: Any, kind: type[Kind], allowed: str) -> Kind:
    """Return `value` if it is an instance of `kind`; ValueError names `allowed` otherwise."""
    if not isinstance(value, kind):
        raise refusal(name, f"be {allowed}", value)
    return value


def require_function(name: str, value: Any) -> Callable[..., Any]:
    """Return `value` if it is callable; ValueError for anything else."""
    if not callable(value):
        raise refusal(name, "be a function", value)
    return value


def require_path(name: str, value: Any) -> pathlib.Path:
    """Return the path of a file; ValueError for anything but text or an `os.PathLike`."""
    text = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(text, str) or not text or "\0" in text:
        raise refusal(name, "be the path of a file", value)
    return pathlib.Path(text)


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

"""Registry of laws by name."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, TypeVar

from .._entry import Range, did_you_mean, ranges, refusal, require_kind
from .base import AbstractLaw

_Law = TypeVar("_Law", bound=type[AbstractLaw])


@dataclasses.dataclass(frozen=True)
class Description:
    """A registered law: its name and class, and its formula, source and range as text."""

    name: str
    cls: type[AbstractLaw]
    formula: str
    source: str
    valid: str

    @property
    def parameters(self) -> dict[str, Range]:
        """The parameters of the law with the range of each."""
        return ranges(self.cls)


_REGISTRY: dict[str, Description] = {}


def register_law(
    name: str, *, formula: str = "", source: str = "", valid: str = ""
) -> Callable[[_Law], _Law]:
    """Return a class decorator that registers a law under `name` for `get_law` and the commands.

    Arguments: `formula` (α(e) or the force), `source` (with doi) and `valid` (the range) are the
    texts shown in tables. Registering the same class again, such as a notebook cell run twice,
    replaces it. Raises ValueError if the name belongs to another class, for a text that is not a
    string, and for a class that is not a law.
    """
    for word, text in {"formula": formula, "source": source, "valid": valid}.items():
        require_kind(word, text, str, "a text")
    if not isinstance(name, str) or not name:
        raise refusal("name", "be a name for the law", name)

    def register(cls: _Law) -> _Law:
        if not (isinstance(cls, type) and issubclass(cls, AbstractLaw)):
            raise refusal(
                "cls", "be a subclass of `AbstractLaw`, the class that is registered", cls
            )
        known = _REGISTRY.get(name)
        if known is not None and known.cls.__qualname__ != cls.__qualname__:
            raise ValueError(
                f"Argument `name` must be new, but {name!r} already names "
                f"`{known.cls.__qualname__}`."
            )
        _REGISTRY[name] = Description(name, cls, formula, source, valid)
        return cls

    return register


def describe(name: str) -> Description:
    """Return the description of a registered law; ValueError lists the known names."""
    if not isinstance(name, str) or name not in _REGISTRY:
        known = ", ".join(_REGISTRY)
        guess = did_you_mean(name, _REGISTRY)
        raise refusal("name", f"be one of {known}", name, guess)
    return _REGISTRY[name]


def get_law(name: str, **parameters: Any) -> AbstractLaw:
    """Build the law called `name` from its parameters: `get_law("hu_guo", e=0.7)`.

    Raises ValueError for an unknown name (the message lists the known ones) or a parameter out of
    its range, TypeError for a parameter the law does not have.
    """
    law = describe(name).cls
    fields = {field.name for field in dataclasses.fields(law)}
    for given in parameters:
        if given not in fields:
            takes = ", ".join(describe(name).parameters) or "none"
            raise TypeError(
                f"{name} has no parameter {given!r}; its parameters: {takes}."
                f"{did_you_mean(given, fields)}"
            )
    return law(**parameters)


def list_laws() -> list[str]:
    """Return the names of all registered laws, including your own, in order of registration."""
    return list(_REGISTRY)


def constant_laws() -> list[str]:
    """Return the names of the laws with e as their only parameter."""
    return [name for name in list_laws() if list(describe(name).parameters) == ["e"]]

"""The interface of a simulator for exports, and the register of simulators."""

from __future__ import annotations

import abc
import inspect
import re
from collections.abc import Mapping
from typing import Any, ClassVar, TypeVar

from .._entry import did_you_mean, require_choice
from .wanted import Draft, Wanted

_ENGINES: dict[str, Engine] = {}

Kind = TypeVar("Kind", bound="Engine")


class Engine(abc.ABC):
    """A simulator whose contact law can be inverted for a restitution.

    `name` is the argument of `export`. The keyword-only arguments of `draft` are the options of the
    engine; one without a default is required.
    """

    name: ClassVar[str]

    @abc.abstractmethod
    def draft(self, wanted: Wanted, **options: Any) -> Draft:
        """Return the engine's law with the parameters that deliver `wanted`.

        Called in double precision. Raises ValueError for a bad option, or a restitution that the
        law cannot deliver.
        """

    def check_options(self, options: Mapping[str, Any]) -> dict[str, Any]:
        """Return the given options without those that are None.

        Raises ValueError for an unknown option or a missing required one.
        """
        parameters = inspect.signature(self.draft).parameters.values()
        takes = {p.name: p.default for p in parameters if p.kind is p.KEYWORD_ONLY}
        chosen = {name: value for name, value in options.items() if value is not None}
        for name in chosen:
            if name not in takes:
                raise ValueError(
                    f"Argument `{name}` must be an option of engine {self.name!r}, which takes "
                    f"{', '.join(f'`{name}`' for name in takes) or 'none'}."
                    f"{did_you_mean(name, takes)}"
                )
        for name, default in takes.items():
            if default is inspect.Parameter.empty and name not in chosen:
                raise ValueError(
                    f"Argument `{name}` is needed for engine {self.name!r}, but is None."
                )
        return chosen


def register_engine(kind: type[Kind]) -> type[Kind]:
    """Register an `Engine` under its `name` for `export`; a decorator of its class."""
    _ENGINES[kind.name] = kind()
    return kind


_OTHERS = {
    "isaac|physx|omniverse": "PhysX, which Isaac Sim and Isaac Lab use, takes restitution itself "
    "as e, above its bounce threshold velocity (2 m/s by default in "
    "PhysX 4: issue 351 of github.com/NVIDIAGameWorks/PhysX) and by the "
    "combine mode of both materials. Its compliant contacts are a "
    "spring and a dashpot by implicit steps; their scheme is unknown, "
    "so nothing is exported",
    "genesis": "Genesis takes MuJoCo's solref and solimp as sol_params, in the positive "
    "format: export to 'mujoco', whose solref there is 2/damping and dampratio; Genesis "
    "was not run",
}
"""Advice for engines without an export, by a pattern of their names."""


def engine_of(name: str) -> Engine:
    """Return the registered engine of this name. Raises ValueError if there is none."""
    for pattern, why in _OTHERS.items():
        if isinstance(name, str) and re.search(pattern, name.casefold()):
            raise ValueError(
                f"Argument `engine` must be one of {', '.join(map(repr, engines()))}, but is "
                f"{name!r}. {why}."
            )
    return _ENGINES[require_choice("engine", name, engines())]


def engines() -> list[str]:
    """Return the names of all registered engines."""
    return sorted(_ENGINES)

"""The impact that a simulator must reproduce, its interface, and the register of simulators."""

from __future__ import annotations

import abc
import dataclasses
import inspect
import re
from collections.abc import Mapping
from typing import Any, ClassVar, TypeVar

import jax.numpy as jnp

from .. import AbstractLaw, Contact, Impact, Luding, Status, WaltonBraun, impact
from ..extend import did_you_mean, require_choice
from .at_time_step import Scheme


@dataclasses.dataclass(frozen=True)
class Wanted:
    """One impact as plain numbers: its outcome, and the contact in which it takes place.

    `law` is the exported law, for engines that have the same one.
    """

    restitution: float
    duration: float
    mass: float
    stiffness: float
    exponent: float
    velocity: float
    law: AbstractLaw | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Draft:
    """An engine's law with the parameters found, before it is solved again."""

    model: str
    law: AbstractLaw
    contact: Contact
    parameters: Mapping[str, float]
    units: Mapping[str, str]
    snippet: str
    limit: str
    source: str
    steps: int | None = None
    """Time steps per contact at which the engine was measured; None if it was not run."""
    expected_error: float | None = None
    scheme: Scheme | None = None
    """Time stepping of the engine; None if its user chooses it, or if it is unknown."""


def require_rebound(hit: Impact) -> Impact:
    """Return `hit` if it is one impact that ended in separation; ValueError otherwise."""
    status = Status(int(hit.status))
    if status is not Status.SEPARATED or not float(hit.restitution) > 0:
        raise ValueError(
            "Arguments `law`, `contact` and `velocity` must make an impact with a rebound, but it "
            f"ended as {status.name.lower()!r} with the restitution {float(hit.restitution):g}."
        )
    return hit


def matched_stiffness(wanted: Wanted, exponent: float, scaled_law: AbstractLaw) -> float:
    """Return K in N/mⁿ of an engine with exponent n: the contact's own, or that of equal duration.

    An impact lasts τ (m/K)^(1/(n+1)) v0^((1-n)/(n+1)), with τ that of `scaled_law`, the engine's
    law in units where mass, stiffness and speed are 1. For different exponents no K gives the same
    force. Equal duration preserves the frequencies that a contact excites.
    """
    if wanted.exponent == exponent:
        return wanted.stiffness
    unit = require_rebound(impact(scaled_law, Contact(1.0, 1.0, exponent), 1.0, throw=False))
    tau = float(unit.duration)
    speed = wanted.velocity ** (1 - exponent)
    return wanted.mass * speed * (tau / wanted.duration) ** (exponent + 1)


def as_luding(law: AbstractLaw | None) -> Luding | None:
    """Return a `Luding`, or a `WaltonBraun` as the same without adhesion; None for other laws."""
    if isinstance(law, WaltonBraun):
        return Luding(ratio=law.ratio, slope=law.slope, adhesion=jnp.zeros(()))
    return law if isinstance(law, Luding) else None


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
                    f"{', '.join(map('`{}`'.format, takes)) or 'none'}."
                    f"{did_you_mean(name, takes)}"
                )
        for name, default in takes.items():
            if chosen.get(name, default) is inspect.Parameter.empty:
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

"""The keywords of `fit` that ready-made fits pass on."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, TypedDict, TypeVar

from .._entry import refuses_unknown, require_flag
from .._text.failure import checked
from .fit import fit
from .problem.problem import Huber

Function = TypeVar("Function", bound=Callable[..., Any])


class SearchKeywords(TypedDict, total=False):
    """Those of the loss and of the search."""

    loss: str | Huber
    noise: str
    optimizer: Any
    starts: int
    spread: float
    seed: int
    max_steps: int | None
    patience: int
    rtol: float
    reverse: bool


class ColumnKeywords(SearchKeywords, total=False):
    """Those of a fit whose columns have their own standard deviations."""

    weights: Any
    groups: Any
    correlation: Any
    transforms: Any
    progress: bool | Callable[[int, float], None] | None
    throw: bool


class FitKeywords(ColumnKeywords, total=False):
    """All but x."""

    sigma: Any


def takes(keywords: type, **defaults: Any) -> Callable[[Function], Function]:
    """Show `keywords` of `fit` in a signature, for its last argument, and refuse unknown ones."""
    passed = inspect.signature(fit).parameters
    added = [passed[name] for name in keywords.__annotations__]
    added = [one.replace(default=defaults.get(one.name, one.default)) for one in added]

    def shown(function: Any) -> Any:
        signature = inspect.signature(function)
        *own, _ = signature.parameters.values()

        @functools.wraps(function)
        def flagging(*given: Any, throw: bool = True, **how: Any) -> Any:
            throw = require_flag("throw", throw)
            return checked(function(*given, **how, throw=False), throw, function.__name__)

        passes_on: Any = flagging if "throw" in keywords.__annotations__ else function
        passes_on.__signature__ = signature.replace(parameters=[*own, *added])
        return refuses_unknown(passes_on)

    return shown

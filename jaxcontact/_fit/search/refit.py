"""The one loop of fits whose errors follow from their own residuals."""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import ClassVar, Generic, TypeVar

F = TypeVar("F")
E = TypeVar("E")


class AbstractErrors(abc.ABC, Generic[F, E]):
    """A model of errors: it estimates them from a fit F, as what the next fit needs, E.

    Sizes of noise, correlations and points left out are such errors. An object serves one `refit`,
    and keeps what it needs from round to round.
    """

    rounds: ClassVar[int]
    """Largest number of refits."""

    @abc.abstractmethod
    def estimate(self, found: F) -> E | None:
        """Return the errors by the residuals of a fit; None if they have settled."""

    def finish(self, found: F) -> F:
        """Return the last fit with what the errors change in it: notes, standard errors."""
        return found


def refit(errors: AbstractErrors[F, E], found: F, search: Callable[[F, E], F]) -> F:
    """Estimate the errors and fit again, in turns, until the errors settle.

    `search` returns the fit with other errors, from the last fit and the errors.
    """
    for _ in range(errors.rounds):
        estimated = errors.estimate(found)
        if estimated is None:
            break
        found = search(found, estimated)
    return errors.finish(found)

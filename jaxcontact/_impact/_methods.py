"""The methods by name, and the choice among them."""

from __future__ import annotations

from typing import ClassVar

from .._forms import AbstractForm, ScaledImpact
from ._event import Event
from ._exact import Exact
from ._front_door import Lanes
from ._method import AbstractMethod
from ._phase import Phase


class Auto(AbstractMethod):
    """The cheapest method that is right: the closed form if there is one, or an event solve."""

    name: ClassVar[str] = "auto"

    def chosen(self, form: AbstractForm, pushed: bool) -> AbstractMethod:
        """`Exact` where it applies, `Event` elsewhere."""
        return Exact() if form.closed_form and not pushed else Event()

    def solve(self, lanes: Lanes) -> ScaledImpact:
        """By the method chosen."""
        return self.chosen(lanes.form, lanes.push is not None).solve(lanes)


NAMED: dict[str, AbstractMethod] = {m.name: m for m in (Auto(), Exact(), Phase(), Event())}


def method_of(method: str | AbstractMethod) -> AbstractMethod:
    """The method object that `method` names or is; ValueError for anything else."""
    if isinstance(method, AbstractMethod):
        return method
    if isinstance(method, str) and method in NAMED:
        return NAMED[method]
    names = ", ".join(map(repr, NAMED))
    raise ValueError(
        f"Argument `method` must be one of {names} or a method object such as "
        f"`jaxcontact.Event(rtol=1e-11)`, but is {method!r}."
    )


def stepping_method(method: str | AbstractMethod) -> Event:
    """The event method with the options of `method`; ValueError for methods that follow no path."""
    how = method_of(method)
    if isinstance(how, Auto):
        return Event()
    if not isinstance(how, Event):
        raise ValueError(
            "Argument `method` must be 'event', 'auto' or a `jaxcontact.Event` for a trajectory, "
            f"but is {method!r}: only an event solve follows the motion in time."
        )
    return how

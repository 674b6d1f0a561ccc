"""The closed form as a method, the choice of a method, and the methods by name."""

from __future__ import annotations

from typing import ClassVar

from ..._entry import refusal, rendered
from ..._forms import AbstractForm, Lane, ScaledImpact
from ..front_door import Lanes
from .event import Event
from .method import AbstractMethod
from .phase import Phase


class Exact(AbstractMethod):
    """The closed form, for free impacts of laws that have one; no options.

    It covers the Hunt-Crossley family and the oscillator laws (Kelvin-Voigt, Tsuji,
    Antypov-Elliott, Thornton, Jankowski). It covers Kuwabara and Kono's law for n = 1 and, by
    series certified to 1e-12, for n = 3/2. It also covers any law whose form has a `solve`. Raises
    ValueError for other laws and with an external force. Source: the energy integral of Hunt &
    Crossley (1975), doi 10.1115/1.3423596, and the references of the laws.
    """

    name: ClassVar[str] = "exact"
    has_formula: ClassVar[bool] = True

    def chosen(self, form: AbstractForm, pushed: bool) -> AbstractMethod:
        """Return the method itself if the form has a closed form and no external force acts."""
        if pushed or not form.closed_form:
            so = "an external force acts" if pushed else "the law has none (see `jaxcontact.Exact`)"
            raise ValueError(
                "Argument `method` must be 'event' or 'auto' here, but is 'exact': a closed form "
                f"exists only for free impacts of some laws, and {so}."
            )
        return self

    def solve(self, lanes: Lanes) -> ScaledImpact:
        """Return the closed-form outcome."""
        solved = lanes.form.solve(lanes.n)
        assert solved is not None  # `chosen` refuses forms without one
        return solved

    def restitution(self, form: AbstractForm) -> Lane | None:
        """Return the e of the form, without impact times."""
        return form.restitution()


class Auto(Exact):
    """The cheapest correct method: the closed form if there is one, else an event solve."""

    name: ClassVar[str] = "auto"

    def chosen(self, form: AbstractForm, pushed: bool) -> AbstractMethod:
        return Exact() if form.closed_form and not pushed else Event()


NAMED: dict[str, AbstractMethod] = {m.name: m for m in (Auto(), Exact(), Phase(), Event())}


def method_of(method: str | AbstractMethod) -> AbstractMethod:
    """Return the method object that `method` names or is; raises ValueError for anything else."""
    if isinstance(method, AbstractMethod):
        return method
    if isinstance(method, str) and method in NAMED:
        return NAMED[method]
    names = ", ".join(map(repr, NAMED))
    must = f"be one of {names} or a method object such as `jaxcontact.Event(rtol=1e-11)`"
    raise refusal("method", must, method)


def stepping_method(method: str | AbstractMethod) -> Event:
    """Return the event method with the options of `method`.

    Raises ValueError for methods that do not compute a path.
    """
    how = method_of(method)
    if isinstance(how, Auto):
        return Event()
    if not isinstance(how, Event):
        raise ValueError(
            "Argument `method` must be 'event', 'auto' or a `jaxcontact.Event` for a trajectory, "
            f"but is {rendered(method)}: only an event solve follows the motion in time."
        )
    return how

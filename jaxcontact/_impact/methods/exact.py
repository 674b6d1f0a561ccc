"""The closed form as a method."""

from __future__ import annotations

from typing import ClassVar

from ..._forms import AbstractForm, Lane, ScaledImpact
from ..front_door import Lanes
from .method import AbstractMethod


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

    def chosen(self, form: AbstractForm, pushed: bool) -> Exact:
        """Return the method itself if the form has a closed form and no external force acts."""
        if pushed or not form.closed_form:
            why = (
                "an external force acts" if pushed else "the law has none (see `jaxcontact.Exact`)"
            )
            raise ValueError(
                "Argument `method` must be 'event' or 'auto' here, but is 'exact': a closed form "
                f"exists only for free impacts of some laws, and {why}."
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

"""The closed form of a law as a method."""

from __future__ import annotations

from typing import ClassVar

from .._forms import AbstractForm, Lane, ScaledImpact
from ._front_door import Lanes
from ._method import AbstractMethod


class Exact(AbstractMethod):
    """The closed form, for free impacts of laws that have one; no options.

    These are the Hunt-Crossley family, the oscillator laws (Kelvin-Voigt, Tsuji, Antypov-Elliott,
    Thornton, Jankowski) and any law whose form has a `solve`. Raises ValueError for other laws and
    with an external force. Source: the energy integral of Hunt & Crossley (1975),
    doi 10.1115/1.3423596, and the references of the laws.
    """

    name: ClassVar[str] = "exact"

    def chosen(self, form: AbstractForm, pushed: bool) -> Exact:
        """Itself, where the form has a closed form and nothing pushes."""
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
        """The closed form."""
        return lanes.form.solve(lanes.n)

    def restitution(self, form: AbstractForm) -> Lane | None:
        """The e of the form, without its times."""
        return form.restitution()

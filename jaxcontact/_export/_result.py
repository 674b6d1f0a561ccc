"""What an export returns."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from .._contact import Contact
from .._laws import AbstractLaw
from .._parameter import POSITIVE, require_number
from .._text.table import text_table
from .._text.units import quantity
from ._holds import SpeedRange, signed, speed_range
from ._stepping import Stepped, stepped
from ._wanted import Draft


@dataclasses.dataclass(frozen=True, kw_only=True)
class Export(Draft):
    """The parameters with which an engine delivers a wanted restitution.

    `engine` and `model` say where they belong; `parameters` holds the numbers and `units` their
    units, by the same names; `snippet` is the text to paste. `velocity` is the closing speed in
    m/s, or several (n,); `target` is the restitution that is wanted there and `delivered` that of
    the engine's law with these parameters, both by `impact`: equal at one speed, and as near as one
    set of parameters can be at several. `wanted_law` and `wanted_contact` are what was exported.
    `law` and `contact` are the engine's law as it was solved: `impact(law, contact, velocity)`
    gives the rest. `duration` in s is how long that contact lasts, and `time_step` in s the step at
    which the engine itself was measured to be within `expected_error` (relative, of the
    restitution, for e of 0.12 and more), `steps` of them in one contact; all None where the engine
    was not run. `scheme` is how it steps, None where that is not known; `at_time_step` says what e
    becomes at another step. `limit` says in words where the parameters do not hold, `source` where
    the engine's formula is given.
    """

    engine: str
    velocity: float | Float[np.ndarray, " n"]
    target: float | Float[np.ndarray, " n"]
    delivered: float | Float[np.ndarray, " n"]
    duration: float
    wanted_law: AbstractLaw
    wanted_contact: Contact

    @property
    def error(self) -> float | Float[np.ndarray, " n"]:
        """The engine's e minus the wanted one, at every speed."""
        return self.delivered - self.target

    def holds(self, within: float = 0.01) -> SpeedRange:
        """Over which closing speeds the engine's e lies within `within` of the law's.

        Returns a `SpeedRange`, which also says by how much it is off beyond. Raises ValueError for
        a `within` that is not positive.
        """
        made = self.law, self.contact
        speeds = np.atleast_1d(self.velocity)
        return speed_range(self.wanted_law, self.wanted_contact, made, speeds, within)

    def at_time_step(self, time_step: float, within: float = 0.01) -> Stepped:
        """The engine's e at a time step in s that is not short beside the contact.

        The engine's scheme is followed over all places within a step where the touch may fall.
        Returns a `Stepped`: the least and the largest e, and how long a contact must last, softer
        or at shorter steps, for e to stay `within` the target. Raises ValueError for several
        speeds, numbers that are not positive, and an engine whose scheme is not known.
        """
        time_step = require_number("time_step", time_step, POSITIVE)
        within = require_number("within", within, POSITIVE)
        if self.scheme is None:
            raise ValueError(
                f"Argument `engine` must be one whose steps are known, but is {self.engine!r}: its "
                "user chooses how it steps, or it was not found out."
            )
        if np.ndim(self.velocity) > 0:
            raise ValueError(
                "Argument `velocity` must be one speed for a time step, but there are "
                f"{np.size(self.velocity)}."
            )
        return stepped(
            self.law,
            self.contact,
            float(self.velocity),
            target=float(self.target),
            duration=self.duration,
            scheme=self.scheme,
            time_step=time_step,
            within=within,
        )

    @property
    def time_step(self) -> float | None:
        """The step in s at which the engine was measured; None if it was not run."""
        return None if self.steps is None else self.duration / self.steps

    def __repr__(self) -> str:
        rows = [(name, f"{x:.9g} {self.units[name]}") for name, x in self.parameters.items()]
        several = np.ndim(self.velocity) > 0
        for name in ("target", "delivered", "duration", "time_step", "expected_error"):
            if several and name in ("target", "delivered"):
                continue
            if (x := getattr(self, name)) is not None:
                more = ", or less" if name == "time_step" else ""
                rows.append((name, quantity(name, f"{x:.9g}") + more))
        return "\n".join(
            [
                f"Export to {self.engine}: {self.model}",
                *text_table(rows, indent=2),
                *self.by_speed(),
                *(f"  | {line}" for line in self.snippet.splitlines()),
                f"  limit: {self.limit}",
                f"  source: {self.source}",
            ]
        )

    def by_speed(self) -> list[str]:
        """The wanted e and the engine's at every speed, as lines; none for one speed."""
        if np.ndim(self.velocity) == 0:
            return []
        columns = (np.atleast_1d(x) for x in (self.velocity, self.target, self.delivered))
        rows = [
            (f"{v:.4g}", f"{wanted:.4f}", f"{e:.4f}", signed(e - wanted))
            for v, wanted, e in zip(*columns, strict=True)
        ]
        head = ("v (m/s)", "wanted e", "engine's e", "error")
        largest = float(np.max(np.abs(self.error)))
        return [
            f"  largest error of e {largest:.2g}, the least that one set of parameters can have:",
            *text_table(rows, header=head, align=">>>>", indent=4),
        ]

"""The friction law that describes a table of oblique impacts."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from typing import Any

import jax
from jaxtyping import ArrayLike

from ..._calibration import FrictionChoice, choose_friction
from ..._contact import Contact
from ..._entry import POSITIVE, RESTITUTION, as_parameter, require_kind, require_number
from ..._friction import AbstractFriction
from ..._impact import RoundBodies
from ..._laws import ExactRestitution
from .rebounds import read_rebounds


@dataclasses.dataclass(frozen=True, repr=False)
class FrictionCalibration:
    """Result of `calibrate_friction`; prints μ with its error, the law, and what to measure next.

    `choice` holds all fits (see `choose_friction`). `restitution` is the e of the normal motion.
    `source` is the origin of the table, and `notes` say how it was read.
    """

    choice: FrictionChoice
    restitution: float
    source: str
    notes: tuple[str, ...]

    @property
    def friction(self) -> AbstractFriction | None:
        """The fitted friction law; None if no fit converged."""
        return None if self.choice.best is None else self.choice.friction()

    @property
    def converged(self) -> bool:
        """True if every fit converged."""
        return all(fit.converged for fit in self.choice.fits.values())

    def to_json(self) -> str:
        """Return the numbers of all fits as JSON."""
        laws = {
            name: {
                "law": type(fit.params).__name__,
                "parameters": dict(zip(fit.names, fit.values.tolist(), strict=True)),
                "standard_errors": {
                    key: None if error != error else error
                    for key, error in fit.standard_errors.items()
                },
                "converged": bool(fit.converged),
                "adequate": fit.adequate,
            }
            for name, fit in self.choice.fits.items()
        }
        content = {
            "source": self.source,
            "restitution": self.restitution,
            "best": self.choice.best,
            "rivals": list(self.choice.rivals),
            "verdict": self.choice.verdict,
            "laws": laws,
        }
        return json.dumps(content, indent=1, ensure_ascii=False) + "\n"

    def __repr__(self) -> str:
        read = f"; read as {'; '.join(self.notes)}" if self.notes else ""
        return f"{self.choice}\n{self.source}, e = {self.restitution:.4g}{read}"


def calibrate_friction(
    source: Any,
    *,
    restitution: float | None = None,
    tangential_ratio: ArrayLike | None = None,
    radius: float | None = None,
    shape: str = "sphere",
    friction: Mapping[str, AbstractFriction] | None = None,
    columns: str | Mapping[str, int | str] | None = None,
    decimal: str | None = None,
    ball: str | None = None,
    sheet: str | int | None = None,
    progress: bool | Callable[[str], None] | None = None,
) -> FrictionCalibration:
    """Fit friction laws to a table of oblique impacts, and choose one (see `choose_friction`).

    Columns are recognised by meaning, units in headings are converted:

    - before the impact `angle` from the normal and `speed`; or `normal_velocity` and
      `tangential_velocity`;
    - after it at least one of `tangential_restitution` v_t'/v_t, `tangential_rebound` v_t',
      `rebound_angle` and `rebound_spin`, positive in the sense of rolling; empty cells are missing
      readings;
    - `e`, the restitution of the normal speeds, whose median is used.

    Arguments: `source`, `columns`, `decimal`, `ball` and `sheet` as in `read_recording`.
    `restitution`: e, if the table has no such column. `tangential_ratio`: κ, 2(1-ν)/(2-ν) for like
    materials; without it κ is fitted. `radius` in m, needed for spins. `shape` of the body:
    "sphere", "shell" or "disc". `friction` and `progress` as in `choose_friction`.

    Returns a `FrictionCalibration`. Raises RecordingError for a table that cannot be read, and
    ValueError for a missing e or radius and for numbers out of range.
    """
    if ball is not None:
        require_kind("ball", ball, str, "the name of a ball or None")
    how = {"columns": columns, "decimal": decimal, "ball": ball, "sheet": sheet}
    table = read_rebounds(source, **how)
    e = table.restitution if restitution is None else restitution
    if e is None:
        raise ValueError(
            f"Argument `restitution` must be given, as {table.source} has no column of e (the "
            "normal speed after over before), but is None."
        )
    # Noise may raise a measured median above 1.
    e = require_number("restitution", min(e, 1.0) if restitution is None else e, RESTITUTION)
    if radius is None and "rebound_spin" in table.outcomes:
        raise ValueError(
            f"Argument `radius` must be given in m, as {table.source} holds spins, but is None."
        )
    if tangential_ratio is not None:
        tangential_ratio = as_parameter(tangential_ratio, "tangential_ratio", POSITIVE)
    bodies = shape if radius is None else RoundBodies(radius, shape=shape)  # pyright: ignore[reportArgumentType]
    with jax.enable_x64(True):
        # The outcome depends on neither mass nor stiffness.
        contact = Contact(1.0, 1.0, tangential_ratio=tangential_ratio)
        choice = choose_friction(
            ExactRestitution(as_parameter(e, "restitution", RESTITUTION)),
            contact,
            table.normal,
            table.tangential,
            friction=friction,
            bodies=bodies,
            progress=progress,
            **table.outcomes,
        )
    return FrictionCalibration(choice, e, table.source, table.notes)

"""What a run leaves behind: states, impacts, and how far they can be trusted."""

from __future__ import annotations

import enum
import os
from typing import Any, BinaryIO, NamedTuple, TextIO

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int

from .._program import traced as traced
from .._text.table import text_table
from .readout.columns import write_csv


class Ending(enum.IntEnum):
    """How a run ended; the values of `Run.status`."""

    COMPLETED = 0
    """It reached its duration."""
    TOO_MANY_IMPACTS = 1
    """There was no room for another impact: its values are NaN. Give a larger `max_impacts`."""
    ACCUMULATED = 2
    """Impacts accumulated where no series is known for them: what comes after is NaN."""
    INVALID_INPUT = 3
    """A number of the scene is out of its range, or bodies overlap at the start: all is NaN."""
    NOT_CONVERGED = 4
    """An impact could not be solved to its tolerance: what comes after is NaN."""
    CROWDED = 5
    """Too many bodies came together for `max_cluster`, of which those that touch at rest count, or
    in a way that is left out (docs/scenes_how.md): what comes after is NaN. Give a larger
    `max_cluster`."""
    WALL_TOO_ABRUPT = 6
    """A wall, a fixed sphere or a shell exceeds its `max_acceleration`: what comes after is NaN."""


class Way(enum.IntEnum):
    """How an impact was solved; the values of `Impacts.way`."""

    INSTANTANEOUS = 0
    """Out of time, with the law's restitution at its closing speed."""
    SERIES = 1
    """The last of a series of bounces on a wall, whose time is summed: the ball rests there."""
    CLOSED_FORM = 2
    """Soft, head-on: by the law's own solution."""
    CORRECTED = 3
    """Soft, slightly oblique or under a weak force: the law's own solution, and a series for what
    that changes."""
    RADIAL = 4
    """Soft, oblique: the radial equation with its angular momentum."""
    COUPLED = 5
    """Soft, with others in contact or under forces: the coupled equations of motion."""


class Impacts(eqx.Module):
    """The impacts of a run in order of time, one in each row of the arrays (K,).

    `time` of touch in s; `first` and `second`, the bodies by their number in the scene, and the
    `face` of a box (-1 where there is none); `closing_speed` in m/s; `restitution` delivered;
    `duration` in s (of a series of bounces, until it ends); `max_force` in N, infinite for an
    impact out of time; `energy_loss` in J; `turn` of the line of centres in rad; `way`, see `Way`;
    `error_estimate`, relative to the closing speed (in a coupled solve, of all its contacts
    together); `tied`: another impact of one of the bodies
    happened at the same time, and their order was chosen. A contact that comes to rest has e = 0
    and an infinite duration; a coupled one that goes on at the end of the run has neither (NaN). Of
    an impact that began before the run (`time` < 0) or goes on at its end `energy_loss` is what is
    lost within the run. In a coupled solve `closing_speed` is the v0 of the law. Rows with `valid`
    False are blank.
    """

    time: Float[Array, " K"]
    first: Int[Array, " K"]
    second: Int[Array, " K"]
    face: Int[Array, " K"]
    closing_speed: Float[Array, " K"]
    restitution: Float[Array, " K"]
    duration: Float[Array, " K"]
    max_force: Float[Array, " K"]
    energy_loss: Float[Array, " K"]
    turn: Float[Array, " K"]
    way: Int[Array, " K"]
    error_estimate: Float[Array, " K"]
    tied: Bool[Array, " K"]
    valid: Bool[Array, " K"]
    names: tuple[str, ...] = eqx.field(static=True)

    def __len__(self) -> int:
        return self.time.shape[-1]

    def to_dict(self) -> dict[str, np.ndarray]:
        """The columns of the rows that are valid, as NumPy arrays by name.

        Raises ValueError for the impacts of a batch of runs: take one with `jax.tree.map`.
        """
        keep = np.asarray(self.valid)
        if keep.ndim != 1:
            raise ValueError(
                "The impacts must be those of one run, but are a batch of the shape "
                f"{keep.shape[:-1]}; `jax.tree.map(lambda x: x[0], run)` takes the first run."
            )
        columns = {k: np.asarray(v)[keep] for k, v in vars(self).items() if k != "names"}
        del columns["valid"]
        return columns

    def _in_words(self) -> dict[str, np.ndarray]:
        """The columns of `to_dict` for people: with the names of bodies, and `way` by its name."""
        columns, names = self.to_dict(), np.array(self.names)
        ways = np.array([way.name for way in Way])
        told = {}
        for name, column in columns.items():
            told[name] = ways[column] if name == "way" else column
            if name in ("first", "second"):
                told[f"{name}_name"] = names[column]
        return told

    def to_dataframe(self) -> Any:
        """The rows that are valid as a data frame of pandas, with names of bodies and ways.

        Raises ImportError without pandas, which comes with `pip install 'jaxcontact[data]'`.
        """
        try:
            import pandas
        except ImportError as error:
            raise ImportError(
                "to_dataframe needs pandas, which comes with `pip install 'jaxcontact[data]'`"
            ) from error
        return pandas.DataFrame(self._in_words())

    def to_csv(self, path: str | os.PathLike[str] | TextIO | BinaryIO) -> None:
        """Write the rows that are valid, with names of bodies and ways.

        `path` names a file, which then appears whole or not at all, or is an open one.
        """
        write_csv(self._in_words(), path)

    def __repr__(self) -> str:
        if isinstance(self.time, Tracer) or not eqx.is_array(self.time) or self.time.ndim != 1:
            return f"Impacts({eqx.tree_pformat(self.time)})"
        columns = self.to_dict()
        count = len(columns["time"])
        header = ["time/s", "bodies", "closing/(m/s)", "e", "duration/s", "force/N", "lost/J", "by"]
        rows = []
        for k in [*range(min(count, 12)), *([-1] if count > 12 else [])]:
            face = "" if columns["face"][k] < 0 else f" face {columns['face'][k]}"
            tied = " (tied)" if columns["tied"][k] else ""
            rows.append(
                [
                    f"{columns['time'][k]:.9g}",
                    f"{self.names[columns['first'][k]]} - {self.names[columns['second'][k]]}{face}",
                    f"{columns['closing_speed'][k]:.6g}",
                    f"{columns['restitution'][k]:.6g}",
                    f"{columns['duration'][k]:.6g}",
                    f"{columns['max_force'][k]:.6g}",
                    f"{columns['energy_loss'][k]:.6g}",
                    Way(int(columns["way"][k])).name.lower().replace("_", " ") + tied,
                ]
            )
        if count > 12:
            rows.insert(-1, ["..."])
        lines = text_table(rows, header=header, indent=2, rule=True)
        return "\n".join([f"{count} impact{'s' * (count != 1)}", *lines])


class Moment(NamedTuple):
    """States at some times: `time` (T,), `position` and `velocity` (T, N, D), `energy` (T,)."""

    time: Float[Array, " T"]
    position: Float[Array, "T N D"]
    velocity: Float[Array, "T N D"]
    energy: Float[Array, " T"]


def ending_words(status: Any) -> str:
    """The name of an ending; several with their counts."""
    if isinstance(status, Tracer) or not eqx.is_array(status):
        return str(status)
    kinds, counts = np.unique(np.asarray(status), return_counts=True)
    names = [Ending(int(kind)).name.lower().replace("_", " ") for kind in kinds]
    if jnp.ndim(status) == 0:
        return names[0]
    return ", ".join(f"{count} {name}" for name, count in zip(names, counts, strict=True))


def flagged(value: Array, good: Array) -> Array:
    """`value` where `good` along its leading axes, else NaN."""
    shape = good.shape + (1,) * (value.ndim - good.ndim)
    return jnp.where(good.reshape(shape), value, jnp.nan)

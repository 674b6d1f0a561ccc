"""The result of a simulated mechanism."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, BinaryIO, TextIO

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from .._coupled.modes import Index, Number
from .._entry import as_parameter, refusal, shown, traced
from .._program import quick
from .._scene.readout.columns import write_csv
from .._scene.result import Ending
from .._text.failure import Flagged
from .._text.words import abridged, text_table
from .problem import SystemLog, SystemProblem
from .reading import SystemStates, growth_of, states_at

if TYPE_CHECKING:
    import xarray

_STATES = {
    "position": ("coordinate", "position q", ""),
    "velocity": ("speed", "velocity v", ""),
    "gap": ("gap_number", "gap, negative in contact", "m"),
    "closing_speed": ("gap_number", "closing speed", "m/s"),
    "force": ("gap_number", "contact force", "N"),
    "energy": (None, "energy of the motion and of contacts", "J"),
    "work": (None, "work since the start", "J"),
}
_CONTACTS = {
    "gap": ("number of the gap", ""),
    "time": ("time of touch", "s"),
    "closing_speed": ("closing speed at touch", "m/s"),
    "restitution": ("restitution delivered", "1"),
    "duration": ("duration of contact", "s"),
    "max_force": ("largest force", "N"),
    "max_depth": ("largest indentation", "m"),
    "energy_loss": ("energy lost", "J"),
}


def dataset(
    states: SystemStates, contacts: dict[str, np.ndarray], status: str, reached: Array
) -> xarray.Dataset:
    """Return the states and contacts of a single run as a dataset. Raises ImportError without
    xarray.
    """
    try:
        import xarray
    except ImportError as error:
        raise ImportError(
            "to_xarray needs xarray, which comes with `pip install 'jaxcontact[data]'`"
        ) from error
    arrays: dict[str, Any] = {}
    for name, (axis, words, unit) in _STATES.items():
        axes = ("time",) if axis is None else ("time", axis)
        arrays[name] = (axes, np.asarray(getattr(states, name)), _attributes(words, unit))
    for name, (words, unit) in _CONTACTS.items():
        arrays[f"contact_{name}"] = (("contact",), contacts[name], _attributes(words, unit))
    time = (("time",), np.asarray(states.time), _attributes("time", "s"))
    return xarray.Dataset(arrays, {"time": time}, {"status": status, "reached": float(reached)})


def _attributes(words: str, unit: str) -> dict[str, str]:
    return {"long_name": words} | ({"units": unit} if unit else {})


if TYPE_CHECKING:
    import xarray


class SystemContacts(eqx.Module):
    """The contacts of a run in the order of their touches, one for each row of the arrays (K,).

    - `gap`: its number among the gaps.
    - `time`: of touch, in s.
    - `closing_speed`: at touch, in m/s.
    - `restitution`: the opening speed where the force vanishes for good over the closing speed at
      touch, as of an `Impact`.
    - `duration`: in s, up to that moment.
    - `max_force`: in N. `max_depth`: the largest indentation in m.
    - `energy_loss`: in J.
    - `valid`: False in blank rows.

    A contact in progress at the end of the run has NaN for restitution and duration.
    """

    gap: Int[Array, " K"]
    time: Float[Array, " K"]
    closing_speed: Float[Array, " K"]
    restitution: Float[Array, " K"]
    duration: Float[Array, " K"]
    max_force: Float[Array, " K"]
    max_depth: Float[Array, " K"]
    energy_loss: Float[Array, " K"]
    valid: Bool[Array, " K"]

    def __len__(self) -> int:
        return self.time.shape[-1]

    def to_dict(self) -> dict[str, np.ndarray]:
        """Return the columns of the valid rows as NumPy arrays by name. Raises ValueError for a
        batch of runs.
        """
        keep = np.asarray(self.valid)
        if keep.ndim != 1:
            raise ValueError(
                "The contacts must be those of one run, but are a batch of the shape "
                f"{keep.shape[:-1]}; `jax.tree.map(lambda x: x[0], run)` takes the first run."
            )
        columns = {name: np.asarray(column)[keep] for name, column in vars(self).items()}
        del columns["valid"]
        return columns

    def to_csv(self, path: str | os.PathLike[str] | TextIO | BinaryIO) -> None:
        """Write the valid rows as CSV. `path` is an open file or a file name. A named file appears
        whole or not at all. Raises ValueError for a batch of runs.
        """
        write_csv(self.to_dict(), path)

    def __repr__(self) -> str:
        if traced(self.time) or not eqx.is_array(self.time) or self.time.ndim != 1:
            return f"SystemContacts({eqx.tree_pformat(self.time)})"
        columns = self.to_dict()
        count = len(columns["time"])
        header = ["touch/s", "gap", "closing/(m/s)", "e", "duration/s", "force/N", "lost/J"]
        names = ("closing_speed", "restitution", "duration", "max_force", "energy_loss")
        rows = [
            [f"{columns['time'][k]:.9g}", str(columns["gap"][k])]
            + [f"{columns[name][k]:.6g}" for name in names]
            for k in range(count)
        ]
        lines = text_table(abridged(rows), header=header, indent=2, rule=True)
        return "\n".join([f"{count} contact{'s' * (count != 1)}", *lines])


class SystemPhases(eqx.Module):
    """The phases in which closed contacts stick or slide, one for each row of the arrays (P,).

    - `gap`: its number among the gaps.
    - `time`: of the start of the phase, in s. A phase lasts until the next one of this gap, or the
      end of its contact.
    - `direction`: 0 if the contact sticks, else the sign of its slip speed; 1 with springs.
    - `valid`: False in blank rows.
    """

    gap: Int[Array, " P"]
    time: Float[Array, " P"]
    direction: Int[Array, " P"]
    valid: Bool[Array, " P"]

    def __len__(self) -> int:
        return self.time.shape[-1]

    def __repr__(self) -> str:
        if traced(self.time) or not eqx.is_array(self.time) or self.time.ndim != 1:
            return f"SystemPhases({eqx.tree_pformat(self.time)})"
        keep = np.flatnonzero(np.asarray(self.valid))
        words = {0: "sticks", 1: "slides forwards", -1: "slides backwards"}
        rows = [
            [f"{self.time[k]:.9g}", str(self.gap[k]), words[int(self.direction[k])]] for k in keep
        ]
        lines = text_table(abridged(rows), header=["start/s", "gap", "phase"], indent=2, rule=True)
        return "\n".join([f"{len(keep)} phase{'s' * (len(keep) != 1)}", *lines])


class SystemMargin(eqx.Module):
    """The distance of a run from another sequence of events, and its sensitivity; scalars.

    - `time`: in s, the smallest time between two touches or ends of contacts of different gaps.
    - `closing_speed`: in m/s, the smallest one at a touch. A grazing touch has no derivative.
    - `growth`: the largest factor by which the run amplifies a small change of its start.
    - `painleve`: the least J_n M⁻¹ (J_n ∓ μ J_t)ᵀ over J_n M⁻¹ J_nᵀ of a sliding contact. Where it
      is 0 or less the contact force presses the contact together. Rigid bodies then have no motion
      or several (Painlevé); the run has that of soft contacts. None without `RigidCoulomb`.

    A derivative holds for the sequence of events that occurred.
    """

    time: Number
    closing_speed: Number
    _problem: SystemProblem
    _log: SystemLog
    _peak: bool = eqx.field(static=True)
    painleve: Number | None = None

    @property
    def growth(self) -> Number:
        """The largest singular value of the derivative of z(T) by z(0), z = (√M q, T √M v).

        M is the diagonal of the mass matrix at the start and T the duration; q without weights if
        it has more numbers than v. It is infinite where the derivative is not finite. Rounding is
        amplified alike: a run of growth G has lost log10 G digits. A program of its own is compiled
        on access.
        """
        return _growth(self._problem, self._peak, self._log.rows)

    def __repr__(self) -> str:
        least = "" if self.painleve is None else f", painleve={shown(self.painleve)}"
        speed = shown(self.closing_speed)
        return f"SystemMargin(time={shown(self.time)} s, closing_speed={speed} m/s{least})"


class SystemRun(Flagged, eqx.Module):
    """The motion of a mechanism, as `simulate` returns it.

    - `states`: `SystemStates` at the times asked for, the start and the end by default.
    - `contacts`, `margin`, `status`: see `SystemContacts`, `SystemMargin` and `Ending`. `ok`: if
      COMPLETED.
    - `phases`: the `SystemPhases` of contacts that stick and slip; None without such friction.
    - `reached`: the time in s up to which the values hold.
    - `steps`: the number of steps. `error_estimate`: their summed errors relative to the speeds, or
      the imbalance of the energy if that is larger.

    `at(times)` returns the states at any times. `final` holds time, position and velocity at the
    end.
    """

    states: SystemStates
    contacts: SystemContacts
    status: Index
    reached: Number
    steps: Index
    error_estimate: Number
    duration: Number
    margin: SystemMargin
    final: SystemStates
    phases: SystemPhases | None = None
    _failures = tuple(Ending)[1:]

    @property
    def time(self) -> Float[Array, " T"]:
        return self.states.time

    @property
    def position(self) -> Float[Array, "T nq"]:
        return self.states.position

    @property
    def velocity(self) -> Float[Array, "T nv"]:
        return self.states.velocity

    @property
    def energy(self) -> Float[Array, " T"]:
        return self.states.energy

    def at(self, time: ArrayLike) -> SystemStates:
        """Return the states at any times between 0 and the duration.

        `time` in s is a number or an array (T,). Values are NaN outside the run, and beyond the
        time that a flagged run reached. Raises ValueError for non-numbers and for more than one
        axis.
        """
        times = as_parameter(time, "time")
        if times.ndim > 1:
            raise refusal("time", "be a number or a list of numbers", time)
        margin = self.margin
        times = jnp.reshape(times, -1).astype(self.reached.dtype)
        return read_states(margin._problem, margin._log, self.reached, margin._peak, times)

    def to_xarray(self) -> xarray.Dataset:
        """Return the states and contacts of a single run as an `xarray.Dataset` with units.

        `position` has the axes (time, coordinate), `velocity` (time, speed), the numbers of gaps
        (time, gap_number), and `energy` and `work` (time). The columns of `contacts` begin with
        `contact_`. Raises ImportError without xarray, which `pip install 'jaxcontact[data]'`
        installs. Raises ValueError for a batch of runs.
        """
        status = Ending.names_of(self.status).replace("_", " ")
        return dataset(self.states, self.contacts.to_dict(), status, self.reached)

    def to_csv(self, path: str | os.PathLike[str] | TextIO | BinaryIO) -> None:
        """Write a CSV table with a row for each time.

        The columns are `time` in s, `energy` and `work` in J, then `position[k]`, `velocity[k]`,
        `gap[k]` in m, `closing_speed[k]` in m/s and `force[k]` in N. `path` is an open file or a
        file name. A named file appears whole or not at all. Raises ValueError for a batch of runs.
        `contacts.to_csv` writes the contacts.
        """
        if self.time.ndim != 1:
            raise ValueError(
                f"The run must be a single one, but is a batch of the shape {self.time.shape[:-1]}."
            )
        columns = {name: np.asarray(getattr(self.states, name)) for name in _SINGLE}
        for name in _SEVERAL:
            values = np.asarray(getattr(self.states, name))
            columns |= {f"{name}[{k}]": values[:, k] for k in range(values.shape[1])}
        write_csv(columns, path)

    def __repr__(self) -> str:
        lines = {
            "duration": f"{shown(self.duration)} s",
            "time": f"{self.time.shape[-1]} times",
            "numbers": f"{self.position.shape[-1]} positions, {self.velocity.shape[-1]} speeds",
            "contacts": str(len(self.contacts)),
            "error": f"{shown(self.error_estimate)} in {shown(self.steps)} steps",
            "margin": f"{shown(self.margin.time)} s, {shown(self.margin.closing_speed)} m/s",
            "status": Ending.names_of(self.status).replace("_", " "),
        }
        least = self.margin.painleve
        plain = eqx.is_array(least) and not traced(least)
        if plain and np.any(np.asarray(least) <= 0):
            lines["painleve"] = f"{shown(least)}, soft contacts decide"
        return "SystemRun\n" + "\n".join(f"  {name:<10}{text}" for name, text in lines.items())


_SINGLE = ("time", "energy", "work")
_SEVERAL = ("position", "velocity", "gap", "closing_speed", "force")

_growth: Any = quick(growth_of)
read_states: Any = eqx.filter_jit(states_at)

"""The result of a simulated mechanism."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from .._coupled.modes import Index, Number
from .._entry import shown, traced
from .._program import quick
from .._scene.result import Ending, cells_of_contacts
from .._text.columns import (
    EventTable,
    WrittenAsCsv,
    as_times,
    dataset,
    digits,
    in_lines,
    quantity_attributes,
    state_columns,
)
from .._text.failure import Flagged
from .problem import SystemLog, SystemProblem
from .reading import SystemStates, growth_of, states_at

if TYPE_CHECKING:
    import xarray

_MEANING = {
    "time": ("time", "s"),
    "position": ("position q", ""),
    "velocity": ("velocity v", ""),
    "gap": ("gap, negative in contact", "m"),
    "closing_speed": ("closing speed", "m/s"),
    "force": ("contact force", "N"),
    "energy": ("energy of the motion and of contacts", "J"),
    "work": ("work since the start", "J"),
    "contact_gap": ("number of the gap", ""),
    "contact_time": ("time of touch", "s"),
    "contact_closing_speed": ("closing speed at touch", "m/s"),
    "contact_restitution": ("restitution delivered", "1"),
    "contact_duration": ("duration of contact", "s"),
    "contact_max_force": ("largest force", "N"),
    "contact_max_depth": ("largest indentation", "m"),
    "contact_energy_loss": ("energy lost", "J"),
}
_AXES = {
    "position": ("coordinate",),
    "velocity": ("speed",),
    **dict.fromkeys(("gap", "closing_speed", "force"), ("gap_number",)),
}


class SystemContacts(EventTable, eqx.Module):
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

    _events = "contact", "contacts"

    def _cells(self) -> dict[str, Iterable[str]]:
        columns = self.to_dict()
        touch, gap = digits(columns["time"], 9), map(str, columns["gap"])
        return {"touch/s": touch, "gap": gap, **cells_of_contacts(columns)}


class SystemPhases(EventTable, eqx.Module):
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

    _events = "phase", "phases"

    def _cells(self) -> dict[str, Iterable[str]]:
        columns = self.to_dict()
        words = {0: "sticks", 1: "slides forwards", -1: "slides backwards"}
        phases = [words[int(direction)] for direction in columns["direction"]]
        start, gap = digits(columns["time"], 9), map(str, columns["gap"])
        return {"start/s": start, "gap": gap, "phase": phases}


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


class SystemRun(WrittenAsCsv, Flagged, eqx.Module):
    """The motion of a mechanism, as `simulate` returns it.

    - `states`: `SystemStates` at the times asked for, the start and the end by default.
    - `contacts`, `margin`, `status`: see `SystemContacts`, `SystemMargin` and `Ending`. `ok`: if
      COMPLETED.
    - `phases`: the `SystemPhases` of contacts that stick and slip; None without such friction.
    - `reached`: the time in s up to which the values hold.
    - `steps`: the number of steps. `error_estimate`: their summed errors relative to the speeds, or
      the imbalance of the energy if that is larger.

    `at(times)` returns the states at any times. `final` holds time, position and velocity at the
    end. `to_csv` writes a row for each time: `time`, `energy` and `work`, then `position[k]`,
    `velocity[k]`, `gap[k]`, `closing_speed[k]` and `force[k]`.
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
        times, margin = as_times(time), self.margin
        times = times.astype(self.reached.dtype)
        return read_states(margin._problem, margin._log, self.reached, margin._peak, times)

    def to_xarray(self) -> xarray.Dataset:
        """Return the states and contacts of a single run as an `xarray.Dataset` with units.

        `position` has the axes (time, coordinate), `velocity` (time, speed), the numbers of gaps
        (time, gap_number), and `energy` and `work` (time). The columns of `contacts` begin with
        `contact_`. Raises ImportError without xarray, which `pip install 'jaxcontact[data]'`
        installs. Raises ValueError for a batch of runs.
        """
        arrays = {
            name: (("time", *_AXES.get(name, ())), np.asarray(values))
            for name, values in self.states._asdict().items()
        }
        coordinates = {"time": arrays.pop("time")}
        for name, column in self.contacts.to_dict().items():
            arrays[f"contact_{name}"] = ("contact",), column
        words = Ending.names_of(self.status).replace("_", " ")
        attributes = {"status": words, "reached": float(self.reached)}
        return dataset(
            arrays, coordinates, attributes, lambda name: quantity_attributes(*_MEANING[name])
        )

    def _columns(self) -> dict[str, np.ndarray]:
        several = "position", "velocity", "gap", "closing_speed", "force"
        return state_columns(self.states, ("time", "energy", "work", *several))

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
        return in_lines("SystemRun", lines)


_growth: Any = quick(growth_of)
read_states: Any = eqx.filter_jit(states_at)

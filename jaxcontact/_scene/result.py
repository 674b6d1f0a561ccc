"""The result of a run: states, impacts and status flags."""

from __future__ import annotations

import enum
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._program import traced as traced
from .._text.columns import EventTable, digits
from .._text.failure import WordedEnum


class Ending(WordedEnum):
    """The endings of a run. All but COMPLETED are failures, with NaN after `Run.reached`."""

    COMPLETED = 0, "The run reached its duration."
    TOO_MANY_IMPACTS = 1, "Pass a larger `max_impacts`."
    ACCUMULATED = (
        2,
        "Impacts accumulated without a known series. Give them a duration, `instantaneous=False`, "
        "or end the run at `run.reached`.",
    )
    INVALID_INPUT = 3, "A number of the scene is out of range, or bodies overlap at the start."
    NOT_CONVERGED = 4, "An impact did not converge to its tolerance. Try another `rtol`."
    CROWDED = 5, "Too many spheres touch, or in an unsupported way. Pass a larger `max_cluster`."
    WALL_TOO_ABRUPT = 6, "A wall, a fixed sphere or a shell exceeds its `max_acceleration`."
    REDUNDANT_STICKING = (
        7,
        "Contacts that stick hold the same motion, so that their friction forces are not unique. "
        "Remove a gap, or use `SpringSlider`.",
    )
    FRICTION_NOT_MODELLED = (
        8,
        "A ball at rest on a slope slides across it, or a friction law has no outcome, as "
        "`MawBarberFawcett` for χ = λκ/2 outside of 1 to 1.75, or for e below 0.5: try "
        "`SpringSlider`.",
    )
    GAINED = 9, "An impact adds energy. Check the sign of the damping of its law."
    NOT_FINITE = (
        10,
        "A function of the mechanism is not finite just after `reached`. Check its force, mass and "
        "gap there; `run.at(0.999 * run.reached)` is a state before.",
    )
    SINGULAR_MASS = (
        11,
        "The mass matrix is not positive definite just after `reached`, so that no motion follows. "
        "Check `mass` there; `run.at(0.999 * run.reached)` is a state before.",
    )
    TOO_MANY_STEPS = (
        12,
        "The run takes a million steps, or steps shorter than the resolution of time. Forces grow "
        "without limit, or vary too fast for the duration: check the energy of "
        "`run.at(0.999 * run.reached)`.",
    )


class SolvedBy(enum.IntEnum):
    """The values of `Impacts.solved_by`: the solution methods of an impact."""

    INSTANTANEOUS = 0
    """Without duration, with the law's restitution at the closing speed."""
    SERIES = 1
    """The last of a series of bounces on a wall. Its time is summed and the ball rests there."""
    CLOSED_FORM = 2
    """Finite duration, head-on: the law's closed form."""
    RADIAL = 4
    """Finite duration, oblique: the radial equation with the angular momentum."""
    COUPLED = 5
    """Finite duration, with other contacts or forces: the coupled equations of motion."""
    SPRING = 6
    """As COUPLED, with a tangential spring in place of the friction law: its bodies touched others,
    or it lasted."""


class Impacts(EventTable, eqx.Module):
    """The impacts of a run in order of time, one for each row of the arrays (K,).

    - `time`: of touch, in s.
    - `first`, `second`: the bodies by their number in the scene.
    - `face`: the face of a box, -1 for other bodies.
    - `closing_speed`: in m/s. In a coupled solve it is the v0 of the law.
    - `restitution`: as delivered, where the force vanishes for good.
    - `duration`: in s, up to that moment. For a series of bounces, up to its end.
    - `max_force`: in N, infinite for an instantaneous impact.
    - `energy_loss`: in J, within the run.
    - `turn`: the turn of the line of centres in rad. `solved_by`: the method, see `SolvedBy`.
    - `error_estimate`: relative to the closing speed. In a coupled solve it includes all its
      contacts.
    - `tied`: True if one of the bodies had another impact at the same time, so that their order was
      chosen.
    - `valid`: False in blank rows.
    - `slip`, `slip_after`: with friction, the sliding speed of the contact point before and after
      in m/s; the second is negative if the point has reversed. None without friction.

    A contact that comes to rest has e = 0 and an infinite duration. A coupled contact still in
    progress at the end of the run has NaN for both. An impact may begin before the run (`time` < 0)
    or continue past its end. Its `energy_loss` is then only the part within the run.
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
    solved_by: Int[Array, " K"]
    error_estimate: Float[Array, " K"]
    tied: Bool[Array, " K"]
    valid: Bool[Array, " K"]
    names: tuple[str, ...] = eqx.field(static=True)
    slip: Float[Array, " K"] | None = None
    slip_after: Float[Array, " K"] | None = None

    _events = "impact", "impacts"

    def _columns(self) -> dict[str, np.ndarray]:
        """Return the columns of `to_dict` with the names of bodies, and `solved_by` by name."""
        columns, names = self.to_dict(), np.array(self.names)
        words = {}
        for name, column in columns.items():
            words[name] = column
            if name == "solved_by":
                words[name] = np.array([SolvedBy(int(way)).name for way in column], str)
            if name in ("first", "second"):
                words[f"{name}_name"] = names[column]
        return words

    def to_dataframe(self) -> Any:
        """Return the valid rows as a pandas data frame, with the names of bodies and ways. Raises
        ImportError without pandas, which `pip install 'jaxcontact[data]'` installs.
        """
        try:
            import pandas
        except ImportError as error:
            raise ImportError(
                "to_dataframe needs pandas, which comes with `pip install 'jaxcontact[data]'`"
            ) from error
        return pandas.DataFrame(self._columns())

    def _cells(self) -> dict[str, Iterable[str]]:
        columns = self.to_dict()
        pairs = zip(*(columns[name] for name in ("first", "second", "face")), strict=True)
        ways = zip(columns["solved_by"], columns["tied"], strict=True)
        return {
            "time/s": digits(columns["time"], 9),
            "bodies": [
                f"{self.names[a]} - {self.names[b]}" + ("" if face < 0 else f" face {face}")
                for a, b, face in pairs
            ],
            **cells_of_contacts(columns),
            "by": [
                SolvedBy(int(way)).name.lower().replace("_", " ") + (" (tied)" if tied else "")
                for way, tied in ways
            ],
        }


def cells_of_contacts(columns: Mapping[str, np.ndarray]) -> dict[str, Iterable[str]]:
    """Return what is printed of every contact, in a scene or a mechanism."""
    printed = {
        "closing/(m/s)": "closing_speed",
        "e": "restitution",
        "duration/s": "duration",
        "force/N": "max_force",
        "lost/J": "energy_loss",
    }
    return {head: digits(columns[name]) for head, name in printed.items()}


class States(NamedTuple):
    """States at given times: `time` (T,), `position` and `velocity` (T, N, D), `energy` (T,).

    With friction `spin` is (T, N) in two dimensions and (T, N, 3) in three; None without.
    """

    time: Float[Array, " T"]
    position: Float[Array, "T N D"]
    velocity: Float[Array, "T N D"]
    energy: Float[Array, " T"]
    spin: Float[Array, "T N ..."] | None = None


def nan_unless(value: Array, valid: Array) -> Array:
    """Return `value` where `valid` along its leading axes, else NaN."""
    shape = valid.shape + (1,) * (value.ndim - valid.ndim)
    return jnp.where(valid.reshape(shape), value, jnp.nan)

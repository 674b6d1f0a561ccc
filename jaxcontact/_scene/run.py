"""The result of `simulate`."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._coupled.modes import Index, Number
from .._entry import shown
from .._program import derived
from .._text.columns import (
    WrittenAsCsv,
    as_times,
    dataset,
    flag_attributes,
    in_lines,
    quantity_attributes,
    state_columns,
)
from .._text.failure import Flagged
from .bodies.bodies import AbstractBody, spheres_of
from .bodies.scene import Scene
from .engine.log import RunRecord
from .readout.final_scene import final_start
from .readout.margin import Margin
from .readout.states import states_at
from .result import Ending, Impacts, SolvedBy, States, traced
from .resume import Start, Underway

if TYPE_CHECKING:
    import xarray

_MEANING = {
    "time": ("time", "s"),
    "position": ("position of the centre", "m"),
    "velocity": ("velocity", "m/s"),
    "spin": ("spin", "rad/s"),
    "slip": ("sliding speed before", "m/s"),
    "slip_after": ("sliding speed after, negative after a reversal", "m/s"),
    "energy": ("energy: kinetic, weight, stored in contacts", "J"),
    "radius": ("radius", "m"),
    "mass": ("mass, infinite where fixed", "kg"),
    "sphere": ("number among the bodies", ""),
    "impact_time": ("time of touch", "s"),
    "first": ("number of one body", ""),
    "second": ("number of the other body", ""),
    "face": ("face of a box, -1 where there is none", ""),
    "closing_speed": ("closing speed", "m/s"),
    "restitution": ("restitution delivered", "1"),
    "duration": ("duration of contact", "s"),
    "max_force": ("largest force", "N"),
    "energy_loss": ("energy lost", "J"),
    "turn": ("turn of the line of centres", "rad"),
    "error_estimate": ("estimated error, relative to the closing speed", "1"),
    "tied": ("another impact of one of the bodies at the same time", ""),
    "body_name": ("name of a body", ""),
    "name": ("name of a sphere", ""),
}


class Run(WrittenAsCsv, Flagged, eqx.Module):
    """The motion of a scene, as `simulate` returns it.

    N is the number of spheres, in the order given, including fixed ones.

    - `time` (T,): in s.
    - `position` (T, N, D), `velocity` (T, N, D): in m and m/s.
    - `energy` (T,): in J, the sum of kinetic energy, gravitational energy and energy stored in
      contacts.
    - `spin`: in rad/s, (T, N) in two dimensions and (T, N, 3) in three; None without friction.
    - `impacts`, `margin`, `status`: see `Impacts`, `Margin` and `Ending`. `ok`: if COMPLETED.
    - `reached`: the time in s up to which the values hold.
    - `wall_work`: the work in J of moving walls, fixed spheres and shells on the others. The final
      energy equals the initial energy plus `wall_work` less the impact losses and `sliding_loss`.
    - `sliding_loss`: the energy in J lost by sliding outside of impacts, as on walls at rest. None
      without friction.

    `at(times)` returns the state at any times. `final` is the scene at the end, from which another
    run continues. `to_csv` writes a row for each time: `time`, `energy`, then `position[k,d]` and
    `velocity[k,d]` of sphere k along axis d, and with friction `spin[k]` or `spin[k,d]`.
    """

    time: Float[Array, " T"]
    position: Float[Array, "T N D"]
    velocity: Float[Array, "T N D"]
    energy: Float[Array, " T"]
    impacts: Impacts
    status: Index
    reached: Number
    wall_work: Number
    duration: Number
    scene: Scene
    _nearest: tuple[Number, Number]
    _record: RunRecord
    spin: Float[Array, "T N ..."] | None = None
    sliding_loss: Number | None = None
    _failures = tuple(Ending)[1:]

    def at(self, time: ArrayLike) -> States:
        """Return the states at any times between 0 and the duration.

        `time` in s is a number or an array (T,). At an instantaneous impact the values are those
        after it. Values are NaN outside the run, and beyond the time that a flagged run reached.
        Raises ValueError for non-numbers and for more than one axis.
        """
        times = as_times(time)
        return states_at(self._record, times)

    @property
    def margin(self) -> Margin:
        """Measures of how far a derivative can be trusted."""
        return Margin(*self._nearest, self._record)

    @property
    def final(self) -> Scene:
        """The scene at the end of the run, with the final positions and velocities of the spheres.

        Resting spheres continue to rest, and contacts in progress continue. Another run of this
        scene lists those contacts with a touch time before zero, and with the energy lost from now
        on. An isolated impact is solved again from its touch. Raises ValueError at a time within an
        impact whose friction is a formula, which has no states inside.
        """
        start: Start | None = derived(final_start, self._record)
        end = self.at(self.duration)
        state = end if traced(end) else jax.tree.map(np.asarray, end)
        position, velocity = state.position[0], state.velocity[0]
        spin = [None] * len(position) if state.spin is None else state.spin[0]
        bodies = list(self.scene.bodies)
        for k, (place, sphere) in enumerate(spheres_of(bodies)):
            if sphere.motion is None:
                state_of_it = jax.device_put((position[k], velocity[k], spin[k]))
                bodies[place] = sphere.moved_to(*state_of_it)
        bodies = [_later(body, self.duration) for body in bodies]
        if start is not None and not traced(self.status):
            start = start.as_needed()
            if start is not None and start.underway is not None:
                _check_known(start.underway, position, self.duration)
        return eqx.tree_at(
            lambda scene: (scene.bodies, scene._start),
            self.scene,
            (tuple(bodies), start),
            is_leaf=lambda leaf: leaf is None,
        )

    def to_xarray(self) -> xarray.Dataset:
        """Return the states and impacts of a single run as an `xarray.Dataset` with units.

        `position` and `velocity` have the axes (time, sphere, axis), and `energy` has (time). The
        columns of `impacts` have (impact), with the time as `impact_time`. `sphere`, `first` and
        `second` are numbers of bodies, whose names are `body_name`. Raises ImportError without
        xarray, which `pip install 'jaxcontact[data]'` installs. Raises ValueError for a batch of
        runs.
        """
        columns = self.impacts.to_dict()
        coordinates = {"time": ("time", np.asarray(self.time))}
        axes = ("time", "sphere", "axis")
        arrays = {
            "position": (axes, np.asarray(self.position)),
            "velocity": (axes, np.asarray(self.velocity)),
            "energy": (("time",), np.asarray(self.energy)),
            "body_name": (("body",), list(self.impacts.names)),
        }
        impact_time = columns.pop("time")
        arrays |= {name: (("impact",), column) for name, column in columns.items()}
        if self.spin is not None:
            arrays["spin"] = axes[: self.spin.ndim], np.asarray(self.spin)
        names, spheres = self.impacts.names, self.scene.spheres
        model = self._record.model
        bodies = model.body[: model.visible]
        masses = [float(sphere.known_mass() or np.inf) for sphere in spheres]
        coordinates |= {
            "sphere": ("sphere", list(bodies)),
            "axis": ("axis", list("xyz"[: self.scene.dimensions])),
            "name": ("sphere", [names[k] for k in bodies]),
            "radius": ("sphere", [float(sphere.radius) for sphere in spheres]),
            "mass": ("sphere", masses),
            "body": ("body", np.arange(len(names))),
            "impact_time": ("impact", impact_time),
        }
        words = Ending.names_of(self.status).replace("_", " ")
        reached, work = float(self.reached), float(self.wall_work)
        attributes = {"status": words, "reached": reached, "wall_work": work}
        return dataset(arrays, coordinates, attributes, _attributes)

    def _columns(self) -> dict[str, np.ndarray]:
        return state_columns(self)

    def __repr__(self) -> str:
        steps = self.position.shape
        lines = {
            "duration": f"{shown(self.duration)} s",
            "time": f"{steps[-3]} times",
            "spheres": f"{steps[-2]} in {steps[-1]}D",
            "impacts": str(len(self.impacts)),
            "margin": f"{shown(self.margin.time)} s, {shown(self.margin.closing_speed)} m/s",
            "status": Ending.names_of(self.status).replace("_", " "),
        }
        if not traced(self) and np.any(np.asarray(self.reached) < np.asarray(self.duration)):
            lines["reached"] = f"{shown(self.reached)} s"
        ways = self.impacts.solved_by
        springs = 0 if traced(ways) else np.sum(np.asarray(ways) == SolvedBy.SPRING)
        if springs:
            why = "contacts that lasted or were of several bodies"
            lines["friction"] = f"a spring for its law in {springs} {why}"
        return in_lines("Run", lines)


def _check_known(underway: Underway, position: Array | np.ndarray, time: Array) -> None:
    """Raise ValueError if there are no states within the impacts at the end of a run."""
    unknown = underway.counts & ~np.all(np.isfinite(position), axis=-1)
    if np.any(unknown):
        sphere = int(np.argmax(unknown))
        touch = float(time) + float(underway.touch[sphere])
        raise ValueError(
            f"`run.final` needs states at the end, {shown(time)} s, but sphere {sphere} is in an "
            f"impact that began at {touch:.6g} s, and its friction law has no states within "
            'impacts. End the run at another time, or use `SpringSlider` of form "force".'
        )


def _later(body: AbstractBody, time: Array) -> AbstractBody:
    """Return a body at a later time; concrete numbers use NumPy, which needs no compilation."""
    if body.motion is None or traced((body, time)):
        return body.after(time)

    def each(of: Callable[[Any], Any], tree: Any) -> Any:
        kinds = (jax.Array, np.ndarray, np.generic)
        return jax.tree.map(lambda leaf: of(leaf) if isinstance(leaf, kinds) else leaf, tree)

    body, time = each(np.asarray, (body, time))
    return each(jax.device_put, body.after(time))


def _attributes(name: str) -> dict[str, Any]:
    if name == "solved_by":
        return flag_attributes("how the impact was solved", SolvedBy)
    return quantity_attributes(*_MEANING.get(name, ()))


@dataclasses.dataclass(frozen=True, kw_only=True)
class EngineRun(WrittenAsCsv):
    """The motion of a scene at the output times of another engine, as `read_run` returns it.

    `time` (T,) in s, `position` (T, N, D) in m, `velocity` (T, N, D) in m/s and `spin` in rad/s are
    those of `Run`, as is `to_csv`; `scene`, `energy` and `animate` of `jc.plot` draw both. `energy`
    (T,) in J is kinetic and gravitational; that stored in contacts is not in it. An engine reports
    no impacts, and there is no state between the output times.
    """

    engine: str
    time: Float[np.ndarray, " T"]
    position: Float[np.ndarray, "T N D"]
    velocity: Float[np.ndarray, "T N D"]
    energy: Float[np.ndarray, " T"]
    spin: Float[np.ndarray, "T N ..."] | None
    scene: Scene

    @property
    def reached(self) -> float:
        """The last output time in s."""
        return float(self.time[-1])

    def _columns(self) -> dict[str, np.ndarray]:
        return state_columns(self)

    def __repr__(self) -> str:
        count, spheres, dimensions = self.position.shape
        return (
            f"EngineRun({self.engine}; {count} times to {self.reached:g} s; spheres: {spheres} in "
            f"{dimensions}D)"
        )

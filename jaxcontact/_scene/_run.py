"""The result of `simulate`."""

from __future__ import annotations

import equinox as eqx
from jaxtyping import Array, ArrayLike, Float, Int

from .._parameter import as_parameter, rendered, shown
from ._log import Log
from ._result import Impacts, Margin, Moment, ending_words, flagged
from ._scene import Scene
from ._states import energy_of, states_at
from ._system import Layout, Numbers


class Run(eqx.Module):
    """The motion of a scene.

    `time` (T,) in s; `position` (T, N, D) in m and `velocity` (T, N, D) in m/s of the N spheres in
    the order given, fixed ones too; `energy` (T,) in J, kinetic and weight; `impacts`, see
    `Impacts`; `margin`, see `Margin`; `status`, see `Ending`; `reached` in s, up to which the
    values hold. `at(times)` gives the state at any times; `final` is the scene at the end, from
    which another run goes on.
    """

    time: Float[Array, " T"]
    position: Float[Array, "T N D"]
    velocity: Float[Array, "T N D"]
    energy: Float[Array, " T"]
    impacts: Impacts
    margin: Margin
    status: Int[Array, ""]
    reached: Float[Array, ""]
    duration: Float[Array, ""]
    scene: Scene
    _layout: Layout
    _numbers: Numbers
    _log: Log
    _written: Int[Array, ""]

    def at(self, time: ArrayLike) -> Moment:
        """The state at any times between 0 and the duration.

        `time` in s, a number or an array (T,). At an impact out of time the values are those after
        it. NaN outside of the run, and after a time that a flagged run did not reach. Raises
        ValueError for what is no number or has more than one axis.
        """
        asked = as_parameter(time, "time")
        if asked.ndim > 1:
            raise ValueError(
                f"Argument `time` must be a number or a list of numbers, but is {rendered(time)}."
            )
        return moment(
            self._layout, self._numbers, self._log, self._written, self.reached, asked.reshape(-1)
        )

    @property
    def final(self) -> Scene:
        """The scene at the end of the run: its spheres where they are then, with their speeds."""
        end = self.at(self.duration)
        bodies = list(self.scene.bodies)
        for k, sphere in enumerate(self.scene.spheres):
            place = self._layout.body[k]
            bodies[place] = sphere.moved_to(end.position[0, k], end.velocity[0, k])
        return eqx.tree_at(lambda scene: scene.bodies, self.scene, tuple(bodies))

    def __repr__(self) -> str:
        steps = self.position.shape
        lines = {
            "duration": f"{shown(self.duration)} s",
            "time": f"{steps[-3]} times",
            "spheres": f"{steps[-2]} in {steps[-1]}D",
            "impacts": str(len(self.impacts)),
            "margin": f"{shown(self.margin.time)} s, {shown(self.margin.closing_speed)} m/s",
            "status": ending_words(self.status),
        }
        return "Run\n" + "\n".join(f"  {name:<10}{text}" for name, text in lines.items())


@eqx.filter_jit
def moment(
    layout: Layout,
    numbers: Numbers,
    log: Log,
    written: Array,
    reached: Array,
    times: Array,
) -> Moment:
    times = times.astype(numbers.dtype)
    position, velocity = states_at(layout, numbers, log, written, times)
    energy = energy_of(layout, numbers, position, velocity)
    good = (times >= 0) & (times <= reached)
    return Moment(times, flagged(position, good), flagged(velocity, good), flagged(energy, good))

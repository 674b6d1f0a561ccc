"""The public function `simulate`, for scenes and for mechanisms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, overload

from jaxtyping import ArrayLike

from ._entry import (
    FRACTION,
    POSITIVE,
    is_list,
    refusal,
    refuses_unknown,
    require_count,
    require_flag,
    require_number,
)
from ._scene.bodies.entry import one_number
from ._scene.bodies.scene import Scene
from ._scene.simulate import require_v0, simulate_scene, times_of
from ._text.progress import Listener, progress_of_run

if TYPE_CHECKING:
    from ._scene.run import Run
    from ._system import System, SystemRun


@overload
def simulate(
    model: Scene,
    duration: ArrayLike,
    *,
    times: ArrayLike | None = None,
    rtol: float = 1e-9,
    instantaneous: bool = False,
    v0: str | float = "peak",
    max_impacts: int | None = None,
    max_cluster: int | None = None,
    progress: bool | Listener | None = None,
    throw: bool = True,
) -> Run: ...


@overload
def simulate(
    model: System,
    duration: ArrayLike,
    *,
    position: ArrayLike,
    velocity: ArrayLike,
    args: Any = None,
    times: ArrayLike | None = None,
    rtol: float = 1e-9,
    v0: str | float = "peak",
    breakpoints: ArrayLike | Sequence[float] = (),
    max_impacts: int | None = None,
    progress: bool | Listener | None = None,
    throw: bool = True,
) -> SystemRun: ...


@refuses_unknown
def simulate(
    model: Scene | System,
    duration: ArrayLike,
    *,
    times: ArrayLike | None = None,
    rtol: float = 1e-9,
    v0: str | float = "peak",
    max_impacts: int | None = None,
    throw: bool = True,
    instantaneous: bool = False,
    max_cluster: int | None = None,
    progress: bool | Listener | None = None,
    position: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    args: Any = None,
    breakpoints: ArrayLike | Sequence[float] = (),
) -> Run | SystemRun:
    """Simulate a scene from impact to impact, with closed-form flights and impact times.

    - `model`: the `Scene`, or a `System`; see below for the latter.
    - `duration`: in s.
    - `times` (T,): output times in s, ascending and within the duration. Default: start and end.
    - `rtol`: the tolerance of each impact, for velocities relative to the closing speed.
    - `instantaneous`: if True, impacts take no time.
    - `v0`: the speed that the damping of a law refers to. "peak" is the largest closing speed since
      touch, which is the speed at touch in a free impact. "touch" is the speed at touch; damping
      grows without bound as it vanishes, so bodies that come to rest take many steps. A number
      in m/s is a lower bound on the speed at touch.
    - `max_impacts`: the capacity for impacts. From Python the default grows as needed, also for
      derivatives. Under `jit` and `vmap` it is fixed (default 256), and `impacts` are padded to it.
      A run that exceeds it is flagged and NaN.
    - `max_cluster`: the capacity of a coupled solve in spheres, at least 2. The default is 8. From
      Python it is all spheres, up to 40 under gravity and 16 without it. It is 16 where bodies move
      as prescribed. Of more, or with periodic axes, a run goes on with 16, 32 and 40.
    - `progress`: for runs from Python. None shows on stderr after a second, in a terminal or
      notebook, that a program compiles, then the simulated time, the number of impacts and the time
      left. True always shows it, False never. A function is called with that number and None, as
      the total is unknown. The run is the same.

    An isolated impact has the duration that its law gives it, and the line of centres turns
    meanwhile. Head-on impacts have a closed form. Oblique ones use the radial equation with the
    angular momentum.

    All other impacts use a coupled solve: a third body nearby, gravity along a wall's normal, a
    contact that comes to rest. It holds the spheres in contact and those that they may reach soon.
    A run that needs more than `max_cluster` is flagged (`Ending.CROWDED`).

    With `instantaneous=True` each impact uses the law's restitution at its closing speed.
    Simultaneous impacts are processed pair by pair, the largest closing speed first, and marked as
    tied. A ball may bounce on a wall under gravity with a constant e < 1. Once the next bounce
    would be lower than `rtol` radii, the time of the infinite series is summed. The ball then rests
    on the wall and slides along it. If impacts accumulate in any other way, the run stops and is
    flagged.

    Returns a `Run`, differentiable in forward and reverse mode with respect to every number of the
    scene. The derivative is that of the order of impacts that occurred (`Run.margin`). Each
    `Ending` but COMPLETED is a failure: it raises `NumericalError` unless `throw` is False. Batches
    and traced runs are flagged in `status` and `ok`, and NaN after `reached`. Raises ValueError for
    arguments out of range.

    A mechanism, a `System`, starts with `position` q (nq,) and `velocity` v (nv,), and its
    functions receive `args`. `breakpoints` are the times in s at which its force jumps. All its
    contacts are solved together, from event to event, and none is stepped over as far as an
    interpolation of each step shows. `rtol` bounds the errors relative to the largest speeds. The
    effective mass in a law is that of its touch, with other gaps open. Under `jit` and `vmap` the
    capacity is 64 contacts by default. A negative gap at the start is a contact in progress, which
    needs v0="peak" or a number. The result is a `SystemRun`. `instantaneous` and `max_cluster`
    belong to scenes only. `progress` counts contacts.

    Source: event-driven simulation with one stored event a body, Lubachevsky (1991),
    doi 10.1016/0021-9991(91)90222-7.
    """
    from_scene = {"instantaneous": instantaneous, "max_cluster": max_cluster}
    of_system = {"position": position, "velocity": velocity, "args": args}
    if isinstance(model, Scene):
        empty = is_list(breakpoints) and not breakpoints
        _refuse("a `Scene`", **of_system, breakpoints=None if empty else breakpoints)
        with progress_of_run(progress) as tell:
            return simulate_scene(
                model,
                duration,
                times=times,
                rtol=rtol,
                v0=v0,
                max_impacts=max_impacts,
                throw=throw,
                instantaneous=instantaneous,
                max_cluster=max_cluster,
                tell=tell,
            )
    from ._system import System, simulate_system

    if not isinstance(model, System):
        raise refusal("model", "be a `Scene` or a `System`", model)
    _refuse("a `System`", **from_scene)
    length = one_number(duration, "duration", POSITIVE)
    with progress_of_run(progress) as tell:
        return simulate_system(
            model,
            length,
            position=_given("position", position),
            velocity=_given("velocity", velocity),
            args=args,
            times=None if times is None else times_of(times, length),
            tolerance=require_number("rtol", rtol, FRACTION),
            v0=require_v0(v0),
            breakpoints=breakpoints,
            most=None if max_impacts is None else require_count("max_impacts", max_impacts, 1),
            tell=tell,
            throw=require_flag("throw", throw),
        )


def _given(name: str, value: Any) -> Any:
    if value is None:
        raise ValueError(f"Argument `{name}` must be given for a `System`, but is None.")
    return value


def _refuse(model: str, **others: Any) -> None:
    """Raise ValueError for an argument that only the other kind of model has."""
    for name, value in others.items():
        if value is not None and value is not False:
            raise ValueError(f"Argument `{name}` must be left out for {model}.")

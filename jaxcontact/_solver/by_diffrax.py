"""The march with a solver or an adjoint of the user's choice, by diffrax."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import diffrax
import jax.numpy as jnp

from .field import Field, Packed, Record, in_time
from .march import Marched, Seen, Tolerance

# Far beyond any end: a nominal end close to the event would stall the step controller.
_FAR = 1e12


class _Watching(diffrax.AbstractWrappedSolver):
    """A solver with a watch; its state holds the start of the last step and the watch's record."""

    solver: Any
    see: Callable[[Any, Record, Record], Any]
    begun: Any

    @property
    def term_structure(self) -> Any:
        """The term structure of the wrapped solver, like all other properties."""
        return self.solver.term_structure

    @property
    def interpolation_cls(self) -> Any:
        return self.solver.interpolation_cls

    @property
    def scan_kind(self) -> Any:
        return self.solver.scan_kind

    @property
    def root_finder(self) -> Any:
        return self.solver.root_finder

    def order(self, terms: Any) -> int | None:
        return self.solver.order(terms)

    def error_order(self, terms: Any) -> Any:
        return self.solver.error_order(terms)

    def func(self, terms: Any, t0: Any, y0: Record, args: Any) -> Record:
        return self.solver.func(terms, t0, y0, args)

    def init(self, terms: Any, t0: Any, t1: Any, y0: Record, args: Any) -> tuple[Any, Record, Any]:
        return self.solver.init(terms, t0, t1, y0, args), y0, self.begun

    def step(
        self,
        terms: Any,
        t0: Any,
        t1: Any,
        y0: Record,
        args: Any,
        solver_state: tuple[Any, Record, Any],
        made_jump: Any,
    ) -> tuple[Record, Record | None, Any, tuple[Any, Record, Any], diffrax.RESULTS]:
        # The start of a step is certainly accepted. A rejected step leaves no record.
        inner, last, seen = solver_state
        seen = self.see(seen, last, y0)
        after, error, dense, inner, result = self.solver.step(
            terms, t0, t1, y0, args, inner, made_jump
        )
        return after, error, dense, (inner, y0, seen), result


def march_by_diffrax(
    field: Field,
    packed: Packed,
    tolerance: Tolerance,
    begun: Seen,
    see: Callable[[Seen, Record, Record], Seen],
    keep: bool = False,
    solver: diffrax.AbstractSolver | None = None,
    adjoint: diffrax.AbstractAdjoint | None = None,
) -> Marched:
    """Solve as `march` does, with an optional solver and adjoint."""
    dtype = packed.start.dtype

    def slope(t: object, vector: Record, field: Field) -> Record:
        return packed.record(in_time(field, packed.moment(vector)))

    def guard(which: int) -> Callable[..., Any]:
        # diffrax compares it with a Python 0.0 of default precision.
        kind = jnp.zeros(()).dtype
        return lambda t, y, field, **kwargs: packed.guards(field, y)[which].astype(kind)

    opened = packed.guards(field, packed.start)
    count = opened.size
    all_steps = [diffrax.SubSaveAt(t0=True, steps=True)] if keep else []
    # Python numbers would give time and state the default precision. A first step given as an array
    # would be checked at run time by a callback, so the controller chooses it. A root finder would
    # bring a callback into the derivative, so the solve ends with the step that contains the event.
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(slope),
        _Watching(diffrax.Dopri8() if solver is None else solver, see, begun),
        t0=jnp.zeros((), dtype),
        t1=jnp.asarray(_FAR, dtype),
        dt0=None,
        y0=packed.start,
        args=field,
        saveat=diffrax.SaveAt(subs=[diffrax.SubSaveAt(t1=True), *all_steps], solver_state=True),
        stepsize_controller=diffrax.PIDController(rtol=tolerance.rtol, atol=tolerance.atol),
        event=diffrax.Event(tuple(map(guard, range(count))), direction=(False,) * count),
        adjoint=diffrax.ForwardMode() if adjoint is None else adjoint,
        max_steps=tolerance.max_steps,
        throw=False,
    )
    states = cast(Any, solution.ys)
    _, before, seen = cast(Any, solution.solver_state)
    steps = solution.stats["num_accepted_steps"]
    after = states[0][-1]
    opened, left = (packed.guards(field, vector) for vector in (before, after))
    closed = jnp.asarray(solution.result == diffrax.RESULTS.event_occurred)
    path = states[1] if keep else None
    return Marched(before, after, closed & (opened > 0) & (left <= 0), steps, seen, path)

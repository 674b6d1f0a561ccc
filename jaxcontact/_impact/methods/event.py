"""The event method: an adaptive solve that ends with the contact."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._entry import require_kind
from ..._forms import AbstractForm, ScaledImpact
from ..._solver.few_or_many import MANY
from ..derivatives import over_lanes, with_sensitivity
from ..front_door import Lanes
from ..motion.motion import Motion
from .method import AbstractMethod, count_field, tolerance_field

if TYPE_CHECKING:
    import diffrax

Out = TypeVar("Out")

# At this rtol and below, derivatives are assumed to matter: then x is a higher power of w, which
# costs steps.
_FOR_SLOPES = 1e-10


def _of_diffrax(kind: str, name: str) -> Any:
    """Return a field for a diffrax object of some kind; None for the default."""

    def convert(value: Any) -> Any:
        if value is None:
            return None
        import diffrax

        return require_kind(name, value, getattr(diffrax, kind), f"a diffrax {kind} or None")

    return eqx.field(default=None, converter=convert)


class Event(AbstractMethod):
    """An adaptive solve that ends with the contact, for every law and with an external force.

    - `rtol`, `atol`: tolerances of the outcome in scaled units, in (0, 1). The default `rtol` is
      1e-9, and 1e-5 in float32, whose rounding allows no less. The default `atol` is `rtol`. Use
      1e-11 for derivatives.
    - `solver`: a diffrax solver. Default: the library's own loop, with the coefficients of Dopri8.
    - `adjoint`: a diffrax adjoint. Default: sensitivities for forward and reverse mode.
    - `max_steps`: the largest number of steps of each half, at least 2.

    A given `solver` or `adjoint` runs in `diffrax.diffeqsolve`, an adjoint alone with Dopri8.
    Numbers may be Python, NumPy or JAX scalars. Raises ValueError for an option out of its range.
    Source: diffrax, Kidger (2021), doi 10.48550/arXiv.2202.02435.
    """

    rtol: float | None = tolerance_field("rtol")
    atol: float | None = tolerance_field("atol")
    solver: diffrax.AbstractSolver[Any] | None = _of_diffrax("AbstractSolver", "solver")
    adjoint: diffrax.AbstractAdjoint | None = _of_diffrax("AbstractAdjoint", "adjoint")
    max_steps: int = count_field("max_steps", 256)
    name: ClassVar[str] = "event"

    @property
    def solved_by(self) -> str:
        """What takes the steps, in words."""
        if self.solver is None and self.adjoint is None:
            return "the library's own loop with Dopri8's coefficients"
        solver = "Dopri8" if self.solver is None else type(self.solver).__name__
        return f"diffrax.diffeqsolve with {solver}"

    def __repr__(self) -> str:
        return f"{super().__repr__()} by {self.solved_by}"

    def chosen(self, form: AbstractForm, pushed: bool) -> Event:
        """Return the method itself."""
        return self

    def error(self, dtype: Any) -> float:
        """Return a hundred times the relative tolerance."""
        return 100 * self.tolerances(dtype)[0]

    def solve(self, lanes: Lanes) -> ScaledImpact:
        """Return the outcome of every distinct lane."""
        # Imported here, because the closed form does not need diffrax.
        from .event_solve import solve_event

        return self.over(lanes.motion(), solve_event)

    def over(self, motion: Motion, solve_lane: Callable[..., Out]) -> Out:
        """Apply `solve_lane(motion, how=self, many=)` to every distinct lane, with derivatives."""
        # A CPU takes lanes in chunks, which are few.
        ours = self.solver is None and self.adjoint is None and jax.default_backend() != "cpu"
        shape = np.broadcast_shapes(*(leaf.shape for leaf in jax.tree.leaves(motion)))
        many = ours and math.prod(shape) >= MANY
        lane = eqx.Partial(solve_lane, how=self, many=many)
        rtol, _ = self.tolerances(jax.tree.leaves(motion)[0].dtype)
        motion = dataclasses.replace(motion, smooth=rtol <= _FOR_SLOPES)
        # A user's adjoint provides its own derivatives.
        lane = lane if self.adjoint is not None else with_sensitivity(lane)
        return over_lanes(lane, motion)

    def tolerances(self, dtype: Any) -> tuple[float, float]:
        """Return the relative and absolute tolerance in a precision."""
        double = dtype == jnp.float64
        floor = 0.0 if double else 1e-5
        rtol = max(self.rtol or (1e-9 if double else 1e-5), floor)
        return rtol, max(self.atol or rtol, floor)

"""What a solve remembers of its way instead of all its states."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from .._forms import Flag
from ._dip import Dip
from ._motion import Moment, Motion, Number, State


class Nearest(NamedTuple):
    """The state of the largest force so far, and those before and after it.

    `fresh`: whether none has come after it yet.
    """

    force: Number
    before: Moment
    at: Moment
    after: Moment
    fresh: Bool[Array, ""]

    def seen(self, last: Moment, now: Moment, force: Number) -> Nearest:
        """With the state `now`, which followed on `last`."""
        last, now = (m._replace(state=m.state._replace(loss=None)) for m in (last, now))
        larger = force > self.force
        chosen = functools.partial(_chosen, larger)
        return Nearest(
            force=jnp.where(larger, force, self.force),
            before=chosen(last, self.before),
            at=chosen(now, self.at),
            after=_chosen(larger | self.fresh, now, self.after),
            fresh=larger,
        )


class Watch(NamedTuple):
    """The last state seen; the largest force and the least; whether the bodies creep to rest; a dip
    of the force.

    `least` is None where the contact cannot pull, and has -F as its force; `creeps` and `dip` are
    None where there is no push, or the force cannot vanish.
    """

    last: Moment
    nearest: Nearest
    least: Nearest | None
    creeps: Bool[Array, ""] | None
    dip: Dip | None

    @staticmethod
    def begin(motion: Motion, start: Moment) -> Watch:
        """Nothing seen yet of a motion from `start` on."""
        nothing = jnp.full_like(start.state.w, -jnp.inf)
        no = jnp.isnan(start.state.w)
        lean = start._replace(state=start.state._replace(loss=None))
        return Watch(
            last=start,
            nearest=Nearest(nothing, lean, lean, lean, no),
            least=Nearest(nothing, lean, lean, lean, no) if motion.may_pull else None,
            creeps=None if motion.push is None else no,
            dip=Dip.begin(start) if motion.may_dip else None,
        )

    def seen(self, motion: Motion, compressing: Flag, now: Moment) -> Watch:
        """With the accepted state `now`."""
        frozen, state = jax.lax.stop_gradient((motion, now.state))
        creeps, dip = self.creeps, self.dip
        if creeps is not None:
            creeps = creeps | frozen.creeps_to_rest(state)
        if dip is not None:
            dip = dip.seen(motion, self.last, now)
        force = frozen.force(state, compressing)
        least = self.least
        if least is not None:
            # Rounding may put the end below w = 0, where there is no force.
            inside = now._replace(state=now.state._replace(w=_not_negative(now.state.w)))
            pull = -frozen.force(state._replace(w=_not_negative(state.w)), compressing)
            least = least.seen(self.last, inside, pull)
        return Watch(now, self.nearest.seen(self.last, now, force), least, creeps, dip)


class Watching(diffrax.AbstractWrappedSolver):
    """A solver of a motion that watches it: what it has seen is its state."""

    solver: Any

    @property
    def term_structure(self) -> Any:
        """That of the solver, as everything else."""
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

    def strong_order(self, terms: Any) -> Any:
        return self.solver.strong_order(terms)

    def error_order(self, terms: Any) -> Any:
        return self.solver.error_order(terms)

    def func(self, terms: Any, t0: Any, y0: State, args: Any) -> State:
        return self.solver.func(terms, t0, y0, args)

    def init(self, terms: Any, t0: Any, t1: Any, y0: State, args: Any) -> tuple[Any, Watch]:
        motion, _ = args
        return self.solver.init(terms, t0, t1, y0, args), Watch.begin(motion, Moment(t0, y0))

    def step(
        self,
        terms: Any,
        t0: Any,
        t1: Any,
        y0: State,
        args: Any,
        solver_state: tuple[Any, Watch],
        made_jump: Any,
    ) -> tuple[State, State | None, Any, tuple[Any, Watch], diffrax.RESULTS]:
        # The start of a step is certain to be accepted. A step that is not leaves no memory.
        (inner, watch), (motion, compressing) = solver_state, args
        watch = watch.seen(motion, compressing, Moment(t0, y0))
        after, error, dense, inner, result = self.solver.step(
            terms, t0, t1, y0, args, inner, made_jump
        )
        return after, error, dense, (inner, watch), result


def _not_negative(w: Number) -> Number:
    return jnp.where(w < 0, 0, w)


def _chosen(first: Flag, yes: Any, no: Any) -> Any:
    return jax.tree.map(functools.partial(jnp.where, first), yes, no)

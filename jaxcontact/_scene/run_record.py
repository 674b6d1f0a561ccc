"""The record of a finished run, from which all results are read."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._coupled.modes import Index, Number
from .arrays.arrays import Numbers, SceneLayout
from .engine.log import Log, LoopOutcome
from .engine.state import CROWDED, FRICTION, NOT_CONVERGED, OVER, RUNNING, TWO_SUPPORTS, Rules
from .result import Ending


class RunRecord(eqx.Module):
    """The scene, the rules and the `tolerance` of a run, and its `outcome`. The run ended at
    `last`; its requested duration is `length`.
    """

    layout: SceneLayout
    numbers: Numbers
    rules: Rules
    tolerance: Number
    outcome: LoopOutcome
    last: Number
    length: Number

    @property
    def log(self) -> Log:
        """The log of the run."""
        return self.outcome.log

    @property
    def counts(self) -> Bool[Array, " K"]:
        """A mask of the log rows that are written."""
        return jnp.arange(self.log.facts.tied.shape[0]) < self.outcome.written

    @property
    def calls(self) -> Bool[Array, " K"] | None:
        """A mask of the rows that are calls of the coupled solve; None if there are none."""
        call = self.log.facts.call
        return None if call is None else call.is_call & self.counts

    @property
    def ends(self) -> Float[Array, "2"]:
        """The start and end times of the run."""
        return jnp.stack([jnp.zeros_like(self.length), self.length])

    def ending(self) -> tuple[Index, Number]:
        """Return the `Ending` of the run and the time up to which its values hold."""
        # A run may end while bodies are in contact.
        searched, valid = self.outcome.status, self.outcome.valid
        stuck = (searched != RUNNING) & (searched != OVER)
        more = self.outcome.more & (searched != OVER)
        status = jnp.where(stuck, int(Ending.ACCUMULATED), int(Ending.COMPLETED))
        crowded = (searched == CROWDED) | (searched == TWO_SUPPORTS)
        status = jnp.where(crowded, int(Ending.CROWDED), status)
        status = jnp.where(searched == NOT_CONVERGED, int(Ending.NOT_CONVERGED), status)
        if self.layout.frictions is not None:
            status = jnp.where(searched == FRICTION, int(Ending.FRICTION_NOT_MODELLED), status)
        status = jnp.where(~stuck & more, int(Ending.TOO_MANY_IMPACTS), status)
        status = jnp.where(valid, status, int(Ending.INVALID_INPUT))
        reached = jnp.where(stuck, self.outcome.now, jnp.where(more | ~valid, -1, self.last))
        abrupt = (self.last < self.length) & (status == int(Ending.COMPLETED))
        status = jnp.where(abrupt, int(Ending.WALL_TOO_ABRUPT), status)
        return status, jax.lax.stop_gradient(reached)

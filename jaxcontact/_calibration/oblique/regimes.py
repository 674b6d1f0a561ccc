"""Which measured impacts slid throughout, and what the measurements therefore determine."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._friction import AbstractFriction
from ..._text.words import counted
from .measurements import Measurements
from .model import ObliqueModel

_IMPACTS = "impact", "impacts"
_ROUNDING = 1e-9
_AT_JUMP = 1e-6


class Regimes(NamedTuple):
    """How many of the impacts that were measured slid throughout, by a friction law.

    `margin` is the least distance of an impact to a jump of its outcome or slope, None for laws
    without jumps.
    """

    slid: int
    count: int
    margin: float | None

    @property
    def has_jumps(self) -> bool:
        """True if the slope of an outcome may jump."""
        return self.margin is not None

    @property
    def at_jump(self) -> bool:
        """True if an impact is at a jump."""
        return self.margin is not None and self.margin < _AT_JUMP

    @property
    def note(self) -> str:
        """What the impacts determine, in words."""
        which = f"{self.slid} of {counted(self.count, _IMPACTS)} slid throughout"
        if self.slid == self.count:
            return f"{which}: only μ follows from them; measure closer to the normal as well"
        if self.slid == 0:
            return f"{which}: μ follows from the tangential spring alone; measure nearer grazing"
        return which


_rebound = eqx.filter_jit(ObliqueModel.rebound)


def regimes_of(friction: AbstractFriction, there: Measurements) -> Regimes:
    """Return the regimes of the measured impacts by a friction law."""
    used = np.any([factor > 0 for factor in there.factor.values()], axis=0)
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        after = _rebound(there.model, friction, {n: jnp.asarray(x) for n, x in there.x.items()})
    # A ramp slides at any speed; in full sliding the impulse has the ratio μ.
    slid = np.asarray(after.impulse_ratio) > np.asarray(friction.mu) * (1 - _ROUNDING)
    margin = None if after.margin is None else float(np.min(np.asarray(after.margin)[used]))
    return Regimes(int(np.sum(slid & used)), int(used.sum()), margin)

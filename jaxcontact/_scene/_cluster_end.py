"""How a coupled solve ended, and with what."""

from __future__ import annotations

from typing import NamedTuple

from jaxtyping import Array, Float, Int

from ._touching import ClusterState

APART, TIME_IS_UP, NOT_CONVERGED, CHANGED, AT_REST, PAUSED = range(6)
"""`ClusterEnd.status`. All pairs are open; `until` was reached; the numbers cannot be trusted; a
pair touched or opened, where `until_change` asked for that; what touches, each body a plane of its
own, does not move along the normal any more; all steps were taken on a way that goes on, as that of
a ball that slides in a shell: another call goes on from here."""


class ClusterEnd(NamedTuple):
    """The `state` at the end, its `status`, and how it was reached.

    `error_estimate`: the larger one of what the steps add up to, relative to the speeds, and of the
    energy that is missing, relative to the energy of the cluster; `error`, the same in m/s. `work`
    in J, of gravity and of prescribed bodies on the free ones.
    """

    state: ClusterState
    work: Float[Array, ""]
    status: Int[Array, ""]
    steps: Int[Array, ""]
    events: Int[Array, ""]
    error_estimate: Float[Array, ""]
    error: Float[Array, ""]

"""The table of impacts, from the log of a run."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ._log import Log, Together
from ._result import Ending, Impacts, Way, flagged
from ._side import side
from ._slots import bodies_of, places
from ._system import Layout, Numbers


class _Rows(eqx.Module):
    """Impacts as columns (K,), with bodies of the engine."""

    time: Float[Array, " K"]
    first: Int[Array, " K"]
    second: Int[Array, " K"]
    closing_speed: Float[Array, " K"]
    restitution: Float[Array, " K"]
    duration: Float[Array, " K"]
    max_force: Float[Array, " K"]
    energy_loss: Float[Array, " K"]
    turn: Float[Array, " K"]
    way: Int[Array, " K"]
    error_estimate: Float[Array, " K"]
    tied: Bool[Array, " K"]
    valid: Bool[Array, " K"]


@eqx.filter_jit
def table_of(
    layout: Layout,
    numbers: Numbers,
    names: tuple[str, ...],
    log: Log,
    written: Int[Array, ""],
    status: Int[Array, ""],
    rows: int | None,
) -> tuple[Impacts, tuple[Array, Array], Int[Array, ""]]:
    """The impacts in order of time, padded to `rows`; the smallest time between rivals and the
    smallest closing speed, see `Margin`; and how many impacts there are.

    Without `rows` there is one for every row of the log and every pair of a coupled solve.
    """
    found = _isolated(log, written)
    if log.facts.call is not None:
        found = jax.tree.map(
            lambda *parts: jnp.concatenate(parts), found, _coupled(layout, numbers, log, written)
        )
    total = jnp.sum(found.valid)
    order = jnp.argsort(jnp.where(found.valid, found.time, jnp.inf), stable=True)[:rows]
    found = jax.tree.map(lambda x: x[order], found)
    bad = status == int(Ending.INVALID_INPUT)
    valid = found.valid & ~bad
    good = valid & (status != int(Ending.TOO_MANY_IMPACTS))
    body, face = jnp.asarray(layout.body), jnp.asarray(layout.face)

    def number(value: Array) -> Array:
        return flagged(value, good)

    def whole(value: Array) -> Array:
        return jnp.where(valid, value, -1)

    rival = log.facts.rival
    counts = jnp.arange(rival.shape[0]) < written
    nearest = jnp.min(jnp.where(counts, rival, jnp.inf), initial=jnp.inf)
    slowest = jnp.min(jnp.where(good, found.closing_speed, jnp.inf), initial=jnp.inf)
    impacts = Impacts(
        time=number(found.time),
        first=whole(body[found.first]),
        second=whole(body[found.second]),
        face=whole(face[found.second]),
        closing_speed=number(found.closing_speed),
        restitution=number(found.restitution),
        duration=number(found.duration),
        max_force=number(found.max_force),
        energy_loss=number(found.energy_loss),
        turn=number(found.turn),
        way=whole(found.way),
        error_estimate=number(found.error_estimate),
        tied=found.tied & valid,
        valid=valid,
        names=names,
    )
    return impacts, (nearest, slowest), total


def _doubt(together: Together, counts: Array) -> Array:
    """What the calls of a contact, from its touch to its end, add up to, in m/s: (K, P)."""
    error = jnp.where(counts[:, 0], jax.lax.stop_gradient(together.error), 0)
    before = jnp.cumsum(error) - error
    began = jnp.where(counts[:, 0], together.began.time, -jnp.inf)
    since = jnp.searchsorted(jax.lax.cummax(began), together.end.since)
    return (before + error)[:, None] - before[jnp.minimum(since, error.shape[0] - 1)]


def _isolated(log: Log, written: Int[Array, ""]) -> _Rows:
    outcome, facts = log.figures.outcome, log.facts
    valid = jnp.arange(facts.tied.shape[0]) < written
    if facts.call is not None:
        valid = valid & ~facts.call.is_call
    return _Rows(
        outcome.time,
        facts.choice.first,
        facts.choice.second,
        outcome.closing,
        outcome.restitution,
        outcome.duration,
        outcome.max_force,
        outcome.energy_loss,
        outcome.turn,
        outcome.way.astype(int),
        outcome.error,
        facts.tied,
        valid,
    )


def _coupled(layout: Layout, numbers: Numbers, log: Log, written: Int[Array, ""]) -> _Rows:
    """The contacts that ended in a coupled solve, or came to rest there."""
    called, together = log.facts.call, log.figures.coupled
    assert called is not None and together is not None
    seats = called.decided.seats
    rows, members = seats.who.shape
    first, second = places(layout, members)
    one, other = bodies_of(layout, members, seats.who)
    # A fixed sphere comes second.
    turned = (other < layout.spheres) & (numbers.inverse_mass[one] == 0)
    one, other = jnp.where(turned, other, one), jnp.where(turned, one, other)
    counts = (called.is_call & (jnp.arange(rows) < written))[:, None]
    began, end = together.began, together.end
    opened = (began.closed > 0.5) & ~(end.closed > 0.5)
    rests = (end.closed > 0.5) & called.rest[:, None]
    # At the end of the run a contact may still go on.
    last = (jnp.arange(rows) == written - 1) & ~called.ends
    lasts = (end.closed > 0.5) & last[:, None]
    apart = end.position[:, first] - end.position[:, second]
    rate = end.velocity[:, first] - end.velocity[:, second]
    flat = second >= members
    radius = jnp.concatenate([numbers.radius, jnp.zeros(layout.walls, numbers.dtype)])
    square = jnp.sum(jnp.square(apart), axis=-1)
    length = jnp.sqrt(jnp.where(square > 0, square, 1))
    length = side(radius[one] + radius[other]) * length
    none = jnp.zeros((members, layout.dimensions), numbers.dtype)
    normal = jnp.concatenate([none, numbers.normal])[second]
    along = jnp.where(flat[None, :, None], normal[None], apart / length[..., None])
    parting = jnp.sum(along * rate, axis=-1)
    closing = jnp.where(end.latched > 0, end.latched, 1)
    e = jnp.where(rests, 0, parting / closing)
    duration = jnp.where(rests, jnp.inf, end.force_until - end.since)
    e, duration = (jnp.where(lasts, jnp.nan, x) for x in (e, duration))
    shape = opened.shape
    nothing = jnp.zeros(shape, apart.dtype)
    columns = _Rows(
        end.since,
        one,
        other,
        end.latched,
        e,
        duration,
        end.max_force,
        end.lost,
        nothing,
        jnp.full(shape, int(Way.COUPLED)),
        _doubt(together, counts) / closing,
        jnp.zeros(shape, bool),
        counts & (opened | rests | lasts),
    )
    return jax.tree.map(lambda x: x.reshape(-1), columns)

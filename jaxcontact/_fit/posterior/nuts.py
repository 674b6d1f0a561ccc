"""Draws from a density by the no-U-turn sampler."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._program import quick
from .density import Density, Mode

_AT_ONCE = 100
"""Draws of one call of the compiled program, which any number of draws then shares."""

_DEPTH = 8
"""Most doublings of a trajectory. Chains wait for each other, so a long one costs all."""

_ACCEPTANCE = 0.95
"""Target acceptance of the step size. At 0.9 a few draws of every skewed density diverge.

An example is the density of a logarithm near its bound.
"""

_SPREAD = 2.0
"""Spread of the starts, in standard deviations of the normal approximation.

Chains that begin far apart and end alike do not depend on their starts.
"""

_HALVINGS = 8
_DEEPEST = 10.0
"""Largest depth of a start below the mode, per coordinate; a normal density falls by 2 on average.

If the approximation is far too wide, a chain farther out would never return.
"""

_WINDOWS = 0.2, 0.5, 1.0
"""Ends of the phases of the warm-up: approach, covariance, and step size for that covariance."""

_PRIOR_DRAWS = 10
"""Weight of the normal approximation in a covariance, in draws."""


class Frame(NamedTuple):
    """Coordinates q in which the density is nearly standard normal: φ = centre + root q."""

    centre: Float[Array, " m"]
    root: Float[Array, "m m"]


class Chains(NamedTuple):
    """State of the chains: that of the sampler, that of its step size, and the draws so far."""

    state: Any
    step: Any
    number: Any


class Draws(NamedTuple):
    """q and φ (chains, draws, m), the parameters (chains, draws, k); and two counts."""

    q: Float[np.ndarray, "chains draws m"]
    phi: Float[np.ndarray, "chains draws m"]
    values: Float[np.ndarray, "chains draws k"]
    divergences: int
    evaluations: int


def draw(density: Density, mode: Mode, chains: int, warmup: int, draws: int, seed: int) -> Draws:
    """Draw from chains that began far apart, after a warm-up."""
    init, _, final = _averaging()
    frame = Frame(jnp.asarray(mode.centre), jnp.asarray(mode.root))
    key = jax.random.key(seed)
    step = jax.tree.map(_number, init(jnp.asarray(0.5)))
    now = Chains(_starting_states(density, frame, key, chains), step, jnp.zeros((), int))
    evaluations, done = chains * (_HALVINGS + 1), 0
    for part in _WINDOWS:
        count = round(part * warmup) - done
        done += count
        now, drawn = _draw_batches(density, frame, now, key, count, True)
        evaluations += drawn.evaluations
        if part == _WINDOWS[1] and drawn.q.size:
            frame, now = _change_frame(frame, now, drawn.q.reshape(-1, drawn.q.shape[-1]))
        if done < warmup:
            now = now._replace(step=jax.tree.map(_number, init(final(now.step))))
    _, drawn = _draw_batches(density, frame, now, key, draws, False)
    return drawn._replace(evaluations=evaluations + drawn.evaluations)


def _averaging() -> Any:
    from blackjax.adaptation.step_size import dual_averaging_adaptation

    return dual_averaging_adaptation(_ACCEPTANCE)


def _number(x: Any) -> Array:
    return jnp.asarray(x, float)


def _draw_batches(
    density: Density, frame: Frame, now: Chains, key: Array, count: int, adapting: bool
) -> tuple[Chains, Draws]:
    """Draw `count` samples of each chain in batches; return the chains and the draws."""
    chains, m = now.state.position.shape
    k = len(density.problem.space.names)
    parts = [[np.zeros((0, chains, size))] for size in (m, m, k)]
    counts = np.zeros(2, int)
    for begin in range(0, count, _AT_ONCE):
        some = min(_AT_ONCE, count - begin)
        flags = jnp.asarray(some), jnp.asarray(adapting)
        now, new, counted = _draw_batch(density, frame, now, key, *flags)
        counts += np.asarray(counted)
        for part, more in zip(parts, new, strict=True):
            part.append(np.asarray(more)[:some])
    q, phi, values = (np.concatenate(part).swapaxes(0, 1) for part in parts)
    return now, Draws(q, phi, values, int(counts[0]), int(counts[1]))


@quick
def _starting_states(density: Density, frame: Frame, key: Array, chains: int) -> Any:
    """Return states of chains around the mode, nearer if the density is too low farther out."""
    import blackjax

    away = _SPREAD * jax.random.normal(jax.random.fold_in(key, 0), (chains, len(frame.centre)))
    nearer = jnp.append(0.5 ** jnp.arange(_HALVINGS), 0)
    starts = nearer[:, None, None] * away
    log_density = _in(density, frame)
    states = jax.vmap(jax.vmap(lambda q: blackjax.nuts.init(q, log_density)))(starts)
    lowest = states.logdensity[-1] - _DEEPEST * len(frame.centre)
    first = jnp.argmax(states.logdensity >= lowest, axis=0)
    return jax.tree.map(lambda x: x[first, jnp.arange(chains)], states)


@eqx.filter_jit
def _draw_batch(
    density: Density, frame: Frame, now: Chains, key: Array, count: Array, adapting: Array
) -> tuple[Chains, tuple[Array, Array, Array], Array]:
    """Draw the next `count` samples, at most `_AT_ONCE`."""
    import blackjax

    kernel, log_density = blackjax.nuts.build_kernel(), _in(density, frame)
    _, update, final = _averaging()
    chains, m = now.state.position.shape
    unit = jnp.ones(m)

    def advance(i: Array, carry: tuple) -> tuple:
        now, q, counted = carry
        keys = jax.random.split(jax.random.fold_in(key, now.number + 1), chains)
        size = jnp.where(adapting, jnp.exp(now.step.log_step_size), final(now.step))

        def one(key: Array, state: Any) -> tuple[Any, Any]:
            return kernel(key, state, log_density, size, unit, _DEPTH)

        state, info = jax.vmap(one)(keys, now.state)
        accepted = jnp.mean(jnp.nan_to_num(info.acceptance_rate))
        step = jax.tree.map(_number, update(now.step, accepted))
        step = jax.tree.map(lambda new, old: jnp.where(adapting, new, old), step, now.step)
        now = Chains(state, step, now.number + 1)
        # Chains wait for the longest trajectory.
        cost = chains * jnp.max(info.num_integration_steps)
        counted += jnp.stack([jnp.sum(info.is_divergent), cost])
        return now, q.at[i].set(state.position), counted

    start = now, jnp.zeros((_AT_ONCE, chains, m)), jnp.zeros(2, int)
    now, q, counted = jax.lax.fori_loop(0, count, advance, start)
    phi = frame.centre + q @ frame.root.T
    space = density.problem.space
    values = jax.vmap(jax.vmap(space.values))(phi[..., : len(space.names)])
    return now, (q, phi, values), counted


def _in(density: Density, frame: Frame) -> Any:
    return lambda q: density(frame.centre + frame.root @ q)


def _change_frame(frame: Frame, now: Chains, q: Float[np.ndarray, "n m"]) -> tuple[Frame, Chains]:
    """Return coordinates in which the draws q are nearly standard normal, and the chains."""
    centre = q.mean(axis=0)
    scatter = (q - centre).T @ (q - centre) + _PRIOR_DRAWS * np.eye(len(centre))
    root = np.linalg.cholesky(scatter / (len(q) + _PRIOR_DRAWS))
    state = now.state
    position = np.linalg.solve(root, (np.asarray(state.position) - centre).T).T
    state = state._replace(
        position=jnp.asarray(position),
        logdensity_grad=jnp.asarray(np.asarray(state.logdensity_grad) @ root),
    )
    new = Frame(frame.centre + frame.root @ centre, frame.root @ root)
    return new, now._replace(state=state)

"""The posterior density of the free coordinates of a fit: its prior, its mode with the normal
approximation there, and draws from it by the no-U-turn sampler.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..._entry import POSITIVE, is_list, rendered, require_number
from ..._program import quick
from ..problem.problem import FitProblem, shortened
from ..problem.space import Space


class Prior(eqx.Module):
    """A normal density for the parameters that are `given`, or a `density` of all of them.

    Both are densities of the parameters x themselves: p(θ) = p(x) |dx/dθ|. A coordinate without one
    is flat in θ.
    """

    given: Bool[Array, " k"]
    mean: Float[Array, " k"]
    width: Float[Array, " k"]
    density: Callable[[Any], Any] | None = None

    def __call__(self, space: Space, theta: Float[Array, " k"]) -> Float[Array, ""]:
        """Return the logarithm of the density of the free coordinates, up to a constant."""
        values, slopes = space.values(theta), space.log_slopes(theta)
        if self.density is not None:
            known = jnp.asarray(self.density(space.tree_of(values)))
            if known.shape != () or not jnp.issubdtype(known.dtype, jnp.floating):
                raise ValueError(
                    "Argument `prior` must return one real number, the logarithm of a density, but "
                    f"returns the shape {known.shape} of type {known.dtype}."
                )
            return known.astype(float) + jnp.sum(slopes)
        off = jnp.where(self.given, values - self.mean, 0) / self.width
        return jnp.sum(jnp.where(self.given, slopes - jnp.square(off) / 2, 0))


def prior_of(prior: Any, space: Space) -> Prior:
    """Return a prior from None, a dict of (mean, standard deviation), or a function of params."""
    k = len(space.names)
    given, mean, width = np.zeros(k, bool), np.zeros(k), np.ones(k)
    if isinstance(prior, Mapping):
        for name, pair in prior.items():
            if name not in space.names:
                raise ValueError(
                    f"Argument `prior` must name fitted numbers, {', '.join(space.names)}, but "
                    f"names {rendered(name)}."
                )
            if not is_list(pair) or len(pair) != 2:
                raise ValueError(
                    f"Argument `prior` must hold (mean, standard deviation) for {name}, but holds "
                    f"{rendered(pair)}."
                )
            i = space.names.index(name)
            given[i] = True
            mean[i] = require_number("prior", pair[0])
            width[i] = require_number("prior", pair[1], POSITIVE)
    elif prior is not None and (not callable(prior) or isinstance(prior, type)):
        raise ValueError(
            "Argument `prior` must be None, a dict of (mean, standard deviation) by name, or a "
            f"function of the parameters, but is {rendered(prior)}."
        )
    density = prior if callable(prior) else None
    return Prior(jnp.asarray(given), jnp.asarray(mean), jnp.asarray(width), density)


class Height(NamedTuple):
    """The log density, its gradient (m,), and minus the curvature (m, m) of the data's part."""

    value: Float[Array, ""]
    gradient: Float[Array, " m"]
    information: Float[Array, "m m"]


class Density(eqx.Module):
    """ln p(θ, ln σ | data) = -Σ ρ(z/σ) - n ln σ + ln p(θ), up to a constant.

    ρ(u) = u²/2, or Huber's; n is the number of points with weight. φ = (θ, ln σ) if the noise is
    `free`, with a prior flat in ln σ; otherwise φ = θ and σ = 1.
    """

    problem: FitProblem
    prior: Prior
    free: bool = eqx.field(static=True)

    def at(self, phi: Float[Array, " m"]) -> Height:
        """Return the height of the density, by the derivatives that the fit used.

        The density is zero where the prediction is not finite.
        """
        problem = self.problem
        k = len(problem.space.names)
        theta, scale = phi[:k], jnp.exp(phi[k]) if self.free else jnp.ones(())
        point = problem.at(theta)
        u, used = point.z / scale, problem.factor > 0
        pull = jnp.clip(u, -problem.limit, problem.limit)
        slope = jnp.where(jnp.isfinite(point.jacobian), point.jacobian, 0) / scale
        before, drift = jax.value_and_grad(lambda at: self.prior(problem.space, at))(theta)
        value = before - jnp.sum(jnp.square(shortened(u, problem.threshold))) / 2
        gradient = drift - slope.T @ pull
        inside = slope * (jnp.abs(u) <= problem.limit)[:, None]
        information = inside.T @ inside
        if self.free:
            count = jnp.sum(used).astype(float)
            value -= count * phi[k]
            gradient = jnp.append(gradient, jnp.sum(pull * u) - count)
            information = jax.scipy.linalg.block_diag(information, 2 * count)
        good = jnp.isfinite(value) & jnp.all(jnp.isfinite(gradient))
        gradient = jnp.where(good, gradient, 0)
        return Height(jnp.where(good, value, -jnp.inf), gradient, information)

    def __call__(self, phi: Float[Array, " m"]) -> Float[Array, ""]:
        """Return the log density, for a caller that differentiates it in either mode.

        A prediction may have forward derivatives only, which reverse mode could not use.
        """
        fixed = jax.lax.stop_gradient(phi)
        value, gradient, _ = jax.lax.stop_gradient(self.at(fixed))
        return value + gradient @ (phi - fixed)


@quick
def height(density: Density, phi: Float[Array, " m"]) -> tuple[Height, Float[Array, "k k"]]:
    """Return the height of a density, and the curvature of its prior."""
    space = density.problem.space
    theta = phi[: len(space.names)]
    return density.at(phi), -jax.hessian(lambda at: density.prior(space, at))(theta)


_STEPS = 100
_GAIN = 1e-6
"""Predicted gain of the log density below which the search ends."""

_SHORTEST = 1e-3
"""Least scale of a logarithm or logit: smaller square roots of the curvature are not used."""

_FLOOR = 1e-13
"""Relative eigenvalue of a scaled curvature below which it is rounding."""


class Mode(NamedTuple):
    """The mode (m,), with a square root (m, m) of the covariance there.

    `prior` (k, k) is the part of the inverse covariance that comes from the prior, and `value` the
    logarithm of the density.
    """

    centre: Float[np.ndarray, " m"]
    root: Float[np.ndarray, "m m"]
    prior: Float[np.ndarray, "k k"]
    value: float = np.nan


def root_of(information: Float[np.ndarray, "m m"]) -> Float[np.ndarray, "m m"]:
    """Return a square root of the inverse, for any scales of the coordinates."""
    size = np.sqrt(np.abs(np.diag(information)))
    size = np.where(size > 0, size, 1)
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    values = np.maximum(np.abs(values), _FLOOR * np.abs(values).max())
    return vectors / np.sqrt(values) / size[:, None]


def find_mode(density: Density, start: Float[np.ndarray, " m"], held: int | None = None) -> Mode:
    """Find the mode, with one coordinate `held`, by damped Gauss-Newton steps with the prior."""
    free = np.arange(len(start)) != held
    unit = density.problem.space.has_unit
    unit = np.append(unit, True) if density.free else unit
    at, damping = np.asarray(start, float), 1e-3

    def height_at(at: np.ndarray) -> tuple[Height, np.ndarray, np.ndarray]:
        """Return the height, the curvature of the prior, and that of both together."""
        here, prior = jax.tree.map(np.asarray, height(density, jnp.asarray(at)))
        whole, k = np.array(here.information), len(prior)
        whole[:k, :k] += np.where(np.isfinite(prior), prior, 0)
        return here, prior, whole

    here, prior, both = height_at(at)
    for _ in range(_STEPS):
        whole = both * np.outer(free, free)
        size = np.sqrt(np.abs(np.diag(whole)))
        size = np.where(unit, np.maximum(size, _SHORTEST), np.where(size > 0, size, 1))
        values, vectors = np.linalg.eigh(whole / np.outer(size, size))
        values = np.maximum(np.abs(values), _FLOOR * np.abs(values).max()) + damping
        along = vectors.T @ (here.gradient * free / size)
        step = free * (vectors @ (along / values) / size)
        if step @ here.gradient < _GAIN and damping < 1:
            break
        there, *curvatures = height_at(at + step)
        if there.value > here.value:
            at, here, damping, (prior, both) = at + step, there, damping / 10, curvatures
        else:
            damping *= 10
    return Mode(at, root_of(both), prior, float(here.value))


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


class Whitened(eqx.Module):
    """A density in coordinates q in which it is nearly standard normal: φ = centre + root q."""

    density: Density
    centre: Float[Array, " m"]
    root: Float[Array, "m m"]

    def __call__(self, q: Float[Array, " m"]) -> Float[Array, ""]:
        return self.density(self.centre + self.root @ q)


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
    whitened = Whitened(density, jnp.asarray(mode.centre), jnp.asarray(mode.root))
    key = jax.random.key(seed)
    step = jax.tree.map(_number, init(jnp.asarray(0.5)))
    now = Chains(_starting_states(whitened, key, chains), step, jnp.zeros((), int))
    evaluations, done = chains * (_HALVINGS + 1), 0
    for part in _WINDOWS:
        count = round(part * warmup) - done
        done += count
        now, drawn = _draw_batches(whitened, now, key, count, True)
        evaluations += drawn.evaluations
        if part == _WINDOWS[1] and drawn.q.size:
            whitened, now = _whiten(whitened, now, drawn.q.reshape(-1, drawn.q.shape[-1]))
        if done < warmup:
            now = now._replace(step=jax.tree.map(_number, init(final(now.step))))
    _, drawn = _draw_batches(whitened, now, key, draws, False)
    return drawn._replace(evaluations=evaluations + drawn.evaluations)


def _averaging() -> Any:
    from blackjax.adaptation.step_size import dual_averaging_adaptation

    return dual_averaging_adaptation(_ACCEPTANCE)


def _number(x: Any) -> Array:
    return jnp.asarray(x, float)


def _draw_batches(
    whitened: Whitened, now: Chains, key: Array, count: int, adapting: bool
) -> tuple[Chains, Draws]:
    """Draw `count` samples of each chain in batches; return the chains and the draws."""
    chains, m = now.state.position.shape
    k = len(whitened.density.problem.space.names)
    parts = [[np.zeros((0, chains, size))] for size in (m, m, k)]
    counts = np.zeros(2, int)
    for begin in range(0, count, _AT_ONCE):
        some = min(_AT_ONCE, count - begin)
        flags = jnp.asarray(some), jnp.asarray(adapting)
        now, new, counted = _draw_batch(whitened, now, key, *flags)
        counts += np.asarray(counted)
        for part, more in zip(parts, new, strict=True):
            part.append(np.asarray(more)[:some])
    q, phi, values = (np.concatenate(part).swapaxes(0, 1) for part in parts)
    return now, Draws(q, phi, values, int(counts[0]), int(counts[1]))


@quick
def _starting_states(whitened: Whitened, key: Array, chains: int) -> Any:
    """Return states of chains around the mode, nearer if the density is too low farther out."""
    import blackjax

    m = len(whitened.centre)
    away = _SPREAD * jax.random.normal(jax.random.fold_in(key, 0), (chains, m))
    nearer = jnp.append(0.5 ** jnp.arange(_HALVINGS), 0)
    starts = nearer[:, None, None] * away
    states = jax.vmap(jax.vmap(lambda q: blackjax.nuts.init(q, whitened)))(starts)
    lowest = states.logdensity[-1] - _DEEPEST * m
    first = jnp.argmax(states.logdensity >= lowest, axis=0)
    return jax.tree.map(lambda x: x[first, jnp.arange(chains)], states)


@eqx.filter_jit
def _draw_batch(
    whitened: Whitened, now: Chains, key: Array, count: Array, adapting: Array
) -> tuple[Chains, tuple[Array, Array, Array], Array]:
    """Draw the next `count` samples, at most `_AT_ONCE`."""
    import blackjax

    kernel = blackjax.nuts.build_kernel()
    _, update, final = _averaging()
    chains, m = now.state.position.shape
    unit = jnp.ones(m)

    def advance(i: Array, carry: tuple) -> tuple:
        now, q, counted = carry
        keys = jax.random.split(jax.random.fold_in(key, now.number + 1), chains)
        size = jnp.where(adapting, jnp.exp(now.step.log_step_size), final(now.step))

        def one(key: Array, state: Any) -> tuple[Any, Any]:
            return kernel(key, state, whitened, size, unit, _DEPTH)

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
    phi = whitened.centre + q @ whitened.root.T
    space = whitened.density.problem.space
    values = jax.vmap(jax.vmap(space.values))(phi[..., : len(space.names)])
    return now, (q, phi, values), counted


def _whiten(known: Whitened, now: Chains, q: np.ndarray) -> tuple[Whitened, Chains]:
    """Return coordinates in which the draws q (n, m) are nearly standard normal, and the chains."""
    centre = q.mean(axis=0)
    scatter = (q - centre).T @ (q - centre) + _PRIOR_DRAWS * np.eye(len(centre))
    root = np.linalg.cholesky(scatter / (len(q) + _PRIOR_DRAWS))
    state = now.state
    position = np.linalg.solve(root, (np.asarray(state.position) - centre).T).T
    state = state._replace(
        position=jnp.asarray(position),
        logdensity_grad=jnp.asarray(np.asarray(state.logdensity_grad) @ root),
    )
    whole = known.centre + known.root @ centre, known.root @ root
    return Whitened(known.density, *whole), now._replace(state=state)

"""The event-terminated solve itself: fields with closed forms, and its two forms of a step."""

import itertools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._solver import Packed, Tolerance, land, march
from jaxcontact._solver.by_diffrax import march_by_diffrax
from jaxcontact._solver.few_or_many import ByLanes
from tests.test_impact.support import UNIT, column, grid, slopes

CLOSE = 1e-11  # a step of order 8 at an rtol of 1e-12, up to the end: measured 3e-12


class Place(NamedTuple):
    x: jax.Array
    v: jax.Array


class Swing(eqx.Module):
    """x'' = -ω² x from x = 1 at rest, until x = 0: after π/(2ω), with the velocity -ω."""

    omega: jax.Array
    smooth = True
    clamped = False

    def rate(self, state):
        return Place(state.v, -jnp.square(self.omega) * state.x)

    def guards(self, state):
        return (state.x,)


class Dive(eqx.Module):
    """x'' = 1 from x = depth, v = -√2 v0: ends at x = 0 or, where it would turn before, there."""

    depth: jax.Array
    smooth = True
    clamped = False

    def rate(self, state):
        return Place(state.v, jnp.ones_like(state.x))

    def guards(self, state):
        return -state.v, state.x


def solved(field, start, marching=march, **options):
    packed = Packed.of(start)
    tolerance = Tolerance(jnp.asarray(1e-12, start.x.dtype), 1e-12, 256)
    last = marching(field, packed, tolerance, packed.start, lambda seen, before, now: now)
    end, smooth = land(field, packed, last)
    return packed.moment(end), jnp.any(last.closed) & smooth


@pytest.mark.parametrize("marching", [march, march_by_diffrax])
def test_the_end_and_its_derivatives(marching):
    def end(omega):
        moment, arrived = solved(Swing(omega), Place(jnp.ones(()), jnp.zeros(())), marching)
        return jnp.where(arrived, jnp.stack([moment.tau, moment.state.v]), jnp.nan)

    def slope(omega):
        slope, value = jax.jacfwd(lambda omega: (end(omega),) * 2, has_aux=True)(omega)
        return slope, (value, slope)

    omega, quarter = 1.3, np.pi / 2
    bend, (value, slope) = jax.jit(jax.jacfwd(slope, has_aux=True))(omega)
    np.testing.assert_allclose(value, [quarter / omega, -omega], CLOSE)
    np.testing.assert_allclose(slope, [-quarter / omega**2, -1], 10 * CLOSE)
    np.testing.assert_allclose(bend, [2 * quarter / omega**3, 0], 1e-8, 1e-8)


def test_what_opens_again_within_a_step_has_ended_it():
    # The step beyond x = 0 continues past the turn, and back above x = 0.
    @jax.jit
    @jax.vmap
    def end(depth):
        return solved(Dive(depth), Place(depth, jnp.full((), -1.0)))

    depth = jnp.asarray([0.3, 0.499, 0.4999999, 0.5000001, 0.7])
    moment, arrived = end(depth)
    assert np.all(arrived)
    np.testing.assert_allclose(
        moment.tau, 1 - np.sqrt(np.maximum(1 - 2 * np.asarray(depth), 0)), CLOSE
    )


def test_a_batch_ends_as_each_lane_alone_does():
    """The motion, its start, or both may differ by lane, also within another `vmap`."""

    def end(omega, x):
        moment, arrived = solved(Swing(omega), Place(x, jnp.zeros(())))
        return jnp.where(arrived, jnp.stack([moment.tau, moment.state.v]), jnp.nan)

    def with_slopes(omega, x):
        return jax.jacfwd(lambda *numbers: (end(*numbers),) * 2, (0, 1), has_aux=True)(omega, x)

    def over_starts(omega, start):
        return jax.vmap(with_slopes, (None, 0))(omega, start)

    omega, start = jnp.linspace(0.7, 2.3, 9), jnp.linspace(0.5, 3.0, 9)
    alone = jax.jit(with_slopes)
    rows = [[alone(w, x) for x in start] for w in omega]
    every = jax.tree.map(lambda *cells: np.reshape(cells, (9, 9, 2)), *itertools.chain(*rows))

    @jax.jit
    def batches(omega, start):
        return (
            jax.vmap(with_slopes, (0, None))(omega, start[0]),
            over_starts(omega[0], start),
            jax.vmap(with_slopes)(omega, start),
            jax.vmap(over_starts, (0, None))(omega[:3], start),
        )

    both = np.arange(9), np.arange(9)
    parts = np.s_[:, 0], np.s_[0], both, np.s_[:3]
    for part, found in zip(parts, batches(omega, start), strict=True):
        for batch, cells in zip(*map(jax.tree.leaves, (found, every)), strict=True):
            np.testing.assert_allclose(batch, cells[part], 1e-13, 1e-13)


@pytest.mark.parametrize(
    "twice", [jax.hessian, lambda f: jax.grad(jax.grad(f))], ids=["forward", "reverse"]
)
def test_reverse_mode_and_then(twice):
    """Either mode of the second derivative of a duration, by the oracle. Measured: 3e-9."""
    some = [c for c in grid("hunt_crossley", n=1.5) if 0.3 <= c.args["alpha"] <= 5]

    def duration(alpha):
        return jc.impact(jc.Damped(alpha=alpha), UNIT[1.5], 1.0, method="event").duration

    found = jax.jit(jax.vmap(twice(duration)))(column(some, "alpha"))
    np.testing.assert_allclose(found, slopes(some, "alpha", "d2")["duration"], 1e-7)


def test_many_lanes_are_computed_by_another_form():
    """With the same values and derivatives, in any order of `vmap` and `jacfwd`."""
    counts = {"few": 0, "many": 0}

    def form(name):
        def computed(x, flag, factor):
            counts[name] += 1
            return jnp.where(flag, jnp.sin(factor * x), 0.0), x

        return computed

    def sine(x):
        return ByLanes(form("few"), form("many"))(x, jnp.asarray(True), 2.0)[0]

    def slope(x):
        return jax.jacfwd(sine)(x)

    x = jnp.linspace(0, 1, 2000)
    exact = np.sin(2 * x), 2 * np.cos(2 * x), -4 * np.sin(2 * x)
    for function, expected in zip((sine, slope, jax.jacfwd(slope)), exact, strict=True):
        for lanes, name in ((5, "few"), (2000, "many")):
            counts.update(few=0, many=0)
            found = jax.jit(jax.vmap(function))(x[:lanes])
            np.testing.assert_allclose(found, expected[:lanes], 1e-14, 1e-15)
            assert counts[name] > 0
            assert name == "many" or counts["many"] == 0
    nested = jax.jit(jax.vmap(jax.vmap(sine)))(x.reshape(40, 50))
    assert counts["many"] > 0
    np.testing.assert_allclose(nested.reshape(-1), exact[0], 1e-14)


SAME_STEPS = 1e-12  # measured 0. The sums of stages may be in another order


def test_large_batches_are_solved_in_chunks():
    """With the values and slopes of small batches; 300 lanes are no whole number of chunks."""

    def restitution(e, speed):
        return jc.impact(jc.HuGuo(e), jc.Contact(0.01, 1e7), speed, method="event").restitution

    flat = jax.jit(jax.vmap(jax.value_and_grad(restitution), (0, None)))
    nested, e = jax.jit(jax.vmap(flat, (0, None))), jnp.linspace(0.2, 0.95, 300)
    assert flat.lower(e, 1.0).as_text().count("x64x") > 0
    expected = np.concatenate([flat(part, 1.0) for part in e.reshape(4, 75)], axis=1)
    for found in (flat(e, 1.0), nested(e.reshape(4, 75), 1.0)):
        np.testing.assert_allclose(np.reshape(found, (2, -1)), expected, rtol=SAME_STEPS)

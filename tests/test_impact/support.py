"""Shared by these tests: the oracle's grid as arrays, its names for an outcome, and units."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import strategies as st

import jaxcontact as jc
from jaxcontact._laws import AbstractOscillator
from tests.oracle import FIELDS, cases

UNIT = {1.0: jc.Contact(1.0, 1.0, 1.0), 1.5: jc.Contact(1.0, 1.0, 1.5)}
"""Contacts whose impact at unit speed is the scaled problem of the oracle, by exponent."""


class GivenRatio(AbstractOscillator):
    """The oscillator with its damping ratio given."""

    zeta: jax.Array
    tension = True

    def damping_ratio(self, contact=None):
        return self.zeta


class GivenRatioOnApproach(GivenRatio):
    """The same, damped on approach only."""

    approach_only = True


def given_ratio(zeta, ending: str) -> AbstractOscillator:
    if ending == "approach":
        return GivenRatioOnApproach(zeta=zeta)
    return GivenRatio(zeta=zeta, tension=ending == "tension")


def scaled(law, n):
    """The free impact in scaled units, in closed form; for laws that depend on nothing else."""
    return law.form(None, None).solve(n)


def grid(function: str, **fixed):
    """The oracle's cases that have the arguments given."""
    return [c for c in cases(function) if all(c.args[k] == x for k, x in fixed.items())]


def column(some, name: str) -> np.ndarray:
    """An argument of the cases, as an array."""
    return np.array([c.args[name] for c in some], float)


def values(some) -> dict[str, np.ndarray]:
    return {f: np.array([c.value[f] for c in some]) for f in FIELDS}


def slopes(some, by: str, table: str = "d") -> dict[str, np.ndarray]:
    """A derivative of the outcome, case by case; NaN where the outcome has a kink."""
    rows = [getattr(c, table)[by] for c in some]
    return {f: np.array([np.nan if r[f] is None else r[f] for r in rows]) for f in FIELDS}


LANES = 16  # as many as the oracle has for one exponent

DAMPING = st.one_of(st.floats(-6, 6).map(lambda x: 10**x), st.sampled_from([0.0, 1e-300, 1e6]))


def lanes(one):
    """Rows of numbers by hypothesis, which fill one program."""
    return st.lists(one, min_size=LANES, max_size=LANES).map(np.array)


def impacts(law, contact, velocity=1.0, **options):
    """`jc.impact` of a row of numbers, in single precision if one of them is, as NumPy arrays.

    All numbers fill `LANES` lanes a call, so that calls of one form, exponent and method share a
    program.
    """
    push = options.pop("external_force", None)
    given = jax.tree.map(np.asarray, (law, contact, velocity, push))
    leaves = jax.tree.leaves(given)
    kind = np.float32 if any(x.dtype == np.float32 for x in leaves) else float
    asked = np.broadcast_shapes(*(x.shape for x in leaves))
    (count,) = asked or (1,)
    rows = -(-count // LANES)

    def filled(x):
        return np.resize(np.broadcast_to(x.astype(kind), count), (rows, LANES))

    given, hits = jax.tree.map(filled, given), []
    for row in range(rows):
        law, contact, velocity, push = jax.tree.map(lambda x, row=row: jnp.asarray(x[row]), given)
        hits.append(jc.impact(law, contact, velocity, external_force=push, **options))
    return jax.tree.map(lambda *x: np.concatenate(x)[:count].reshape(asked), *hits)


def outcome(hit, initial_energy=0.5) -> dict[str, jax.Array]:
    """A `jc.Impact` or a scaled outcome under the oracle's names, the loss as the oracle has it."""
    e = hit.restitution
    lost = hit.energy_loss / initial_energy if isinstance(hit, jc.Impact) else (1 - e) * (1 + e)
    rest = {f: getattr(hit, f) for f in FIELDS if f not in ("e", "energy_loss")}
    return {"e": e, "energy_loss": lost, **rest}


def errors(got, want) -> dict[str, np.ndarray]:
    """Relative errors; those of the energy loss in units of the initial energy."""
    result = {}
    for f in FIELDS:
        reference = np.asarray(want[f], np.float64)
        error = np.abs(np.asarray(got[f], np.float64) - reference)
        elastic = reference == 0
        result[f] = error if f == "energy_loss" else error / np.where(elastic, 1, np.abs(reference))
    return result


def assert_within(errors_, tolerances: dict[str, float], labels=None) -> None:
    """Every error within its tolerance; NaN is not."""
    for f, tolerance in tolerances.items():
        bad = ~(errors_[f] <= tolerance)
        where = np.flatnonzero(bad) if labels is None else np.asarray(labels)[bad]
        assert not bad.any(), f"{f}: {np.nanmax(errors_[f]):.2e} > {tolerance:.0e} at {where}"


def both_jacobians(solve, p):
    """The value and the slopes by a vector p, forward and in reverse, from one linearisation."""
    value, forward = jax.linearize(solve, p)
    backward = jax.linear_transpose(forward, p)
    ahead = jax.vmap(forward, out_axes=-1)(jnp.eye(p.size))
    rows = jnp.eye(value.size).reshape(-1, *value.shape)
    (back,) = jax.vmap(backward)(rows)
    return value, ahead, back.reshape(ahead.shape)


def slopes_of_lanes(function):
    """Values and slopes in both modes of lanes (L, p), by one program."""
    program = jax.jit(jax.vmap(lambda p: both_jacobians(function, p)))
    return lambda at: [np.asarray(part) for part in program(jnp.asarray(at))]


def central(solve, at, k, h):
    """The central difference by the logarithm of the k-th number of each lane."""
    high, low = (solve(at * np.where(np.arange(at.shape[1]) == k, f, 1)) for f in (1 + h, 1 - h))
    return (high[0] - low[0]) / (2 * h)


def finite(tree) -> bool:
    return all(np.isfinite(x).all() for x in jax.tree.leaves(tree))


def assert_same(found, wanted, names, at=(), **within):
    """The numbers of two results, or what `at` selects of them."""
    for name in names:
        pair = (np.asarray(getattr(result, name))[at] for result in (found, wanted))
        np.testing.assert_allclose(*pair, err_msg=name, **within)


def assert_slopes(solve, at, h, within, relative=1e-7, **modes):
    """Values and slopes of `slopes_of_lanes`: both modes agree, and central differences.

    Slopes are logarithmic, except where a value is zero.
    """
    at = np.asarray(at)
    values, forward, backward = solve(at)
    np.testing.assert_allclose(forward, backward, **modes)
    size = np.where(values == 0, 1, np.abs(values))
    for k in range(at.shape[1]):
        difference = central(solve, at, k, h) / size
        np.testing.assert_allclose(
            forward[:, :, k] * at[:, k : k + 1] / size, difference, relative, within
        )
    return values, forward


def family(kind, **fixed):
    """The oracle's cases of a kind, their damping, and the law of a damping."""
    some = grid(kind, **fixed)
    name, law = {
        "hunt_crossley": ("alpha", lambda x: jc.Damped(alpha=x)),
        "oscillator": ("zeta", lambda x: given_ratio(x, fixed["ending"])),
        "kuwabara_kono": ("a", lambda x: jc.KuwabaraKono(A=x, tension=fixed["tension"])),
    }[kind]
    return some, column(some, name), law


def errors_of(hit, some) -> dict[str, np.ndarray]:
    """Of an impact beside the oracle's cases."""
    return errors(outcome(hit), values(some))

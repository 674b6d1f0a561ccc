"""Batches of soft runs: a lane without a solve causes no steps of one; single precision."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._coupled import step as _coupled_step
from jaxcontact._scene.pair_impact import radial as _radial
from tests.oracle.scene_oracle import Ball, Spring, run

# Parameters: the offset of the second ball, the gap to the third, the mass of the first. Cases: all
# impacts separate and head-on, oblique, simultaneous; none; and an invalid scene.
HEAD_ON, OBLIQUE, TOGETHER = (0.0, 5.0, 1.0), (0.05, 5.0, 1.0), (0.0, 0.0, 1.0)
PAST, WRONG = (0.3, 5.0, 1.0), (0.0, 5.0, -1.0)

SINGLE = 3e-6
"""Of float32 against Newton's equations, relative to the speed at the start: measured 4e-7."""


def collision(offset, gap, mass):
    """A ball hits a second one, which may hit a third one meanwhile."""
    dtype = offset.dtype
    places = [[0 * offset, 0.5 + 0 * offset], [0.5 + 0 * offset, 0.5 + offset]]
    places.append([0.7001 + gap, 0.5 + offset])
    speeds = np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]], dtype)
    balls = [
        jc.Sphere(0.1, mass + k, jnp.stack(x), v)
        for k, (x, v) in enumerate(zip(places, speeds, strict=True))
    ]
    end = jc.simulate(jc.Scene(balls, jc.Hertz(), stiffness=1e6), 0.8, max_impacts=5)
    return end.velocity[-1], end.impacts.solved_by, end.status


@pytest.fixture
def steps(monkeypatch):
    """The steps of both solves that are made while a program runs, by their names."""
    made = {}
    for name, module in (("radial", _radial), ("coupled", _coupled_step)):

        def counted(*given, name=name, step=module.step_and_slope):
            jax.debug.callback(lambda: made.update({name: made[name] + 1}))
            return step(*given)

        monkeypatch.setattr(module, "step_and_slope", counted)
    yield made
    # Traced functions are cached forever.
    jax.clear_caches()


@pytest.mark.slow(reason="a soft scene in a batch")
def test_only_lanes_that_need_a_solve_cause_steps(steps):
    jax.clear_caches()
    batch = jax.jit(jax.vmap(collision))

    def count(*lanes):
        steps.update(radial=0, coupled=0)
        velocity, ways, status = batch(*jnp.array(lanes).T)
        jax.effects_barrier()
        bad = jc.Ending.INVALID_INPUT
        assert status.tolist() == [bad if lane == WRONG else jc.Ending.COMPLETED for lane in lanes]
        return dict(steps), velocity, ways[:, 0].tolist()

    free, v, ways = count(HEAD_ON, HEAD_ON, HEAD_ON)
    assert ways == [jc.SolvedBy.CLOSED_FORM] * 3
    assert free == {"radial": 0, "coupled": 0}
    np.testing.assert_allclose(v[0, :, 0], [-1 / 3, 2 / 3, 0.0], atol=1e-14)
    # Beside lanes without an impact and without a scene.
    beside, w, ways = count(PAST, HEAD_ON, WRONG)
    assert ways == [-1, jc.SolvedBy.CLOSED_FORM, -1] and beside == free
    np.testing.assert_array_equal(w[0, :, 0], [1.0, 0.0, 0.0])
    np.testing.assert_array_equal(w[1], v[0])
    assert np.all(np.isnan(w[2]))
    radial, w, ways = count(OBLIQUE, OBLIQUE, OBLIQUE)
    assert ways == [jc.SolvedBy.RADIAL] * 3
    each = radial["radial"] // len(w)
    assert 20 < each < 200 and radial == {"radial": len(w) * each, "coupled": 0}
    coupled, u, ways = count(TOGETHER, TOGETHER, TOGETHER)
    assert ways == [jc.SolvedBy.COUPLED] * 3
    assert 20 < coupled["coupled"] < 1000 and coupled["radial"] == 0
    # All of them in one batch: each lane takes its own steps.
    mixed, x, ways = count(HEAD_ON, OBLIQUE, TOGETHER)
    assert ways == [jc.SolvedBy.CLOSED_FORM, jc.SolvedBy.RADIAL, jc.SolvedBy.COUPLED]
    assert mixed == {"radial": each, "coupled": coupled["coupled"] // len(u)}
    np.testing.assert_allclose(x, [v[0], w[0], u[0]], rtol=0, atol=1e-13)


def test_single_precision():
    ways = [jc.SolvedBy.CLOSED_FORM, jc.SolvedBy.RADIAL, jc.SolvedBy.COUPLED]
    for lane, way in zip((HEAD_ON, OBLIQUE, TOGETHER), ways, strict=True):
        velocity, solved_by, status = collision(*np.array(lane, np.float32))
        assert velocity.dtype == jnp.float32 and status == jc.Ending.COMPLETED
        # A formula is used if its error is below rounding.
        assert solved_by[0] == way
        offset, gap, _ = lane
        places = [[0.0, 0.5], [0.5, 0.5 + offset], [0.7001 + gap, 0.5 + offset]]
        speeds = [[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]]
        balls = [
            Ball(x, v, 0.1, 1.0 + k) for k, (x, v) in enumerate(zip(places, speeds, strict=True))
        ]
        exact = run(balls, Spring(1e6), 0.8).velocity
        np.testing.assert_allclose(velocity.astype(float), exact, rtol=0, atol=SINGLE)

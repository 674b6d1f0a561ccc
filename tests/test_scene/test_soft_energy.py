"""Impacts that take time: energy over many of them, rest and waking, a batch."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc

BALANCE, GAS = 1e-9, 1e-8
"""Energy at the end against the start less what was lost, relative: measured 6e-12 (8 impacts with
rest) and 6e-10 (1237 impacts of a gas)."""


def test_a_ball_rests_slides_and_wakes():
    """It sinks in by its static indentation, is hit by another one, and rests again."""
    balls = [
        jc.Sphere(0.1, 1.0, [0.0, 0.1005], [0.1, 0.0]),
        jc.Sphere(0.1, 1.0, [0.25, 2.5]),
    ]
    floor = jc.Plane([0.0, 0.0], [0.0, 1.0])
    scene = jc.Scene([*balls, floor], jc.HuGuo(e=0.3), stiffness=1e6, gravity=[0.0, -9.81])
    run = jc.simulate(scene, 1.5, times=np.linspace(0, 1.5, 16))
    assert run.status == jc.Ending.COMPLETED
    hits = run.impacts.to_dict()
    assert np.all(hits["way"] == jc.Way.COUPLED)
    assert hits["duration"][0] == np.inf and hits["restitution"][0] == 0
    sunk = (9.81 / 1e6) ** (2 / 3)
    np.testing.assert_allclose(run.position[1:7, 0, 1], 0.1 - sunk, atol=1e-6 * sunk)
    np.testing.assert_allclose(run.position[1:7, 0, 0], 0.01 * np.arange(1, 7), rtol=1e-12)
    # The output at 0.7 is inside of the contacts of three bodies.
    assert hits["time"][1] < 0.7 < hits["time"][3] + hits["duration"][3]
    assert np.all(np.diff(run.energy) < 1e-8)
    lost = np.sum(hits["energy_loss"])
    assert abs(run.energy[0] - run.energy[-1] - lost) < BALANCE * run.energy[0]
    with pytest.raises(ValueError, match="at which no bodies touch, for `final` to go on from"):
        _ = run.final
    # Traced, nothing can be raised: a run that goes on from there is flagged.
    ends = eqx.filter_jit(lambda run: [ball.position for ball in run.final.spheres])(run)
    assert np.all(np.isnan(ends))


@pytest.mark.slow
def test_a_gas_of_soft_elastic_balls_keeps_its_energy():
    rng = np.random.default_rng(2)
    places = [[0.2, 0.2], [0.7, 0.3], [0.3, 0.7], [0.75, 0.75]]
    balls = [jc.Sphere(0.05, 1.0 + 0.2 * k, x, rng.normal(size=2)) for k, x in enumerate(places)]
    box = jc.Box([0.0, 0.0], [1.0, 1.0])
    run = jc.simulate(jc.Scene([*balls, box], jc.Hertz(), stiffness=1e9), 100.0)
    assert len(run.impacts) > 1000
    assert {int(way) for way in run.impacts.way} == {2, 3, 4}
    assert abs(run.energy[-1] / run.energy[0] - 1) < GAS


def test_crowds_are_refused_not_guessed():
    """Nine balls, three of which touch at once: no room for two in a coupled solve."""
    row = [jc.Sphere(0.1, 1.0, [x], [v]) for x, v in ((-0.5, 1.0), (0.0, 0.0), (0.2, 0.0))]
    rest = [jc.Sphere(0.1, 1.0, [float(x)]) for x in range(2, 8)]
    scene = jc.Scene([*row, *rest], jc.Hertz(), stiffness=1e6)
    run = jc.simulate(scene, 1.0, times=[0.1, 1.0], max_cluster=2)
    assert run.status == jc.Ending.CROWDED
    assert np.all(np.isfinite(run.position[0])) and np.all(np.isnan(run.position[1]))


def test_a_batch_of_soft_pairs():
    """Lanes that hit head-on, pass each other, and are invalid."""

    def ends(height, mass):
        balls = [
            jc.Sphere(0.1, mass, jnp.stack([0.0, height]), [1.0, 0.0]),
            jc.Sphere(0.1, 1.0, [1.0, 0.0]),
        ]
        scene = jc.Scene(balls, jc.Damped(alpha=0.5), stiffness=1e6)
        run = jc.simulate(scene, 2.0, max_impacts=2)
        return run.velocity[-1], run.status, run.impacts.valid.sum()

    height, mass = jnp.array([0.0, 0.3, 0.1, 0.0]), jnp.array([1.0, 1.0, 1.0, -1.0])
    velocity, status, count = jax.jit(jax.vmap(ends))(height, mass)
    assert status.tolist() == [0, 0, 0, jc.Ending.INVALID_INPUT]
    assert count.tolist() == [1, 0, 1, 0]
    e = float(jc.restitution(jc.Damped(alpha=0.5)))
    np.testing.assert_allclose(velocity[0, :, 0], [(1 - e) / 2, (1 + e) / 2], rtol=1e-9)
    np.testing.assert_array_equal(velocity[1, :, 0], [1.0, 0.0])
    assert np.all(np.isnan(velocity[3])) and np.all(np.isfinite(velocity[2]))

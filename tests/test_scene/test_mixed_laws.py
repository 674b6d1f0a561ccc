"""Scenes whose pairs have laws of different kinds, against Newton's equations."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from benchmarks.scenes import SKIPS
from tests.oracle.scene_oracle import Ball, Spring, Wall, run
from tests.test_scene.support import spheres

K, ALPHA, A, C = 1e6, 0.6, 4e-4, 2e5
RTOL = 1e-7


@dataclass(frozen=True)
class Viscoelastic(Spring):
    """K (d^n + n A d^(n-1) d'), with tension."""

    A: float = 0.0

    def force(self, depth: float, rate: float, speed: float) -> float:
        depth, n = max(depth, 0.0), self.exponent
        return self.stiffness * (depth**n + n * self.A * depth ** (n - 1) * rate)


@dataclass(frozen=True)
class Hysteresis(Spring):
    """K d^n + C d^n d'."""

    C: float = 0.0

    def force(self, depth: float, rate: float, speed: float) -> float:
        depth = max(depth, 0.0)
        return depth**self.exponent * (self.stiffness + self.C * rate)


SPRINGS = {
    ("a", "b"): (jc.Hertz(), Spring(K)),
    ("b", "c"): (jc.KuwabaraKono(A=A), Viscoelastic(K, A=A)),
    ("a", "floor"): (jc.ConstantDamping(c=C), Hysteresis(K, C=C)),
    # The same kind with other numbers.
    ("b", "floor"): (jc.ConstantDamping(c=C / 2), Hysteresis(K, C=C / 2)),
    "default": (jc.Damped(alpha=ALPHA), Spring(K, alpha=ALPHA)),
}

NAMES = "a", "b", "c", "floor"

STARTS = {
    # All impacts are isolated; that of a and b is oblique.
    "apart": ([[0.0, 0.6], [0.5, 0.62], [1.3, 0.6]], [[1.0, -0.2], [0.0, -0.3], [-0.8, -0.1]], 1.2),
    # The three meet in a row, on the floor.
    "together": (
        [[0.0, 0.1003], [0.2005, 0.1001], [0.4008, 0.102]],
        [[1.0, -0.3], [0.0, -0.3], [0.0, -0.5]],
        0.06,
    ),
}


def simulated(place, speed, duration):
    balls = spheres(0.1, [1.0, 2.0, 3.0], place, speed, names=NAMES[:3])
    floor = jc.Plane([0.0, 0.0], [0.0, 1.0], name="floor")
    laws = {pair: law for pair, (law, _) in SPRINGS.items()}
    return jc.simulate(jc.Scene([*balls, floor], laws, stiffness=K), duration, rtol=RTOL)


@pytest.mark.slow("apart", reason="a soft scene with a table of laws")
@pytest.mark.parametrize("name", STARTS)
def test_runs_end_where_newtons_equations_do(name):
    place, speed, duration = STARTS[name]
    balls = [Ball(x, v, 0.1, 1.0 + k) for k, (x, v) in enumerate(zip(place, speed, strict=True))]

    def spring(i, j):
        pair = NAMES[i], NAMES[j]
        return SPRINGS.get(pair, SPRINGS["default"])[1]

    exact = run(balls, spring, duration, [Wall([0.0, 0.0], [0.0, 1.0])])
    found = simulated(place, speed, duration)
    assert found.status == jc.Ending.COMPLETED
    coupled = name == "together"
    assert np.any(found.impacts.solved_by == jc.SolvedBy.COUPLED) == coupled
    assert len(found.impacts) == (5 if coupled else 3)
    np.testing.assert_allclose(found.velocity[-1], exact.velocity, atol=10 * RTOL)
    np.testing.assert_allclose(found.position[-1], exact.position, atol=10 * RTOL * duration)
    lost = sum(touch.lost for touch in exact.touches)
    np.testing.assert_allclose(np.sum(found.impacts.energy_loss), lost, atol=10 * RTOL)


SAME, SOLVED = 1e-11, 1e-9
"""Of velocities of about 1 m/s; where a solve takes the place of a closed form, its `rtol`:
measured 6e-15 and 3e-11."""


@pytest.mark.slow(
    "Hertz by its closed form, or by its force",
    "Hertz, or a damping of 0",
    "four balls at rest, or hopping",
    "one shared law, or a table of equal ones",
    reason="two soft scenes",
)
@pytest.mark.parametrize("name", SKIPS)
def test_the_result_is_the_same(name):
    lean, whole = (np.asarray(jax.jit(way)(jnp.asarray(1.0))) for way in SKIPS[name][:2])
    assert np.all(np.isfinite(lean)) and np.max(np.abs(lean)) > 0.1
    np.testing.assert_allclose(whole, lean, rtol=0, atol=SOLVED if SKIPS[name].soft else SAME)

"""Unneeded parts of a scene are skipped with the same result."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks.scene_skips import SKIPS

SAME, SOLVED = 1e-11, 1e-9
"""Of velocities of about 1 m/s; where a solve takes the place of a closed form, its `rtol`:
measured 6e-15 and 3e-11."""


@pytest.mark.slow(
    "Hertz by its closed form, or by its force",
    "Hertz, or a damping of 0",
    "a slightly oblique pair by its formula, or not",
    "four balls at rest, or hopping",
    "one shared law, or a table of equal ones",
    reason="two soft scenes",
)
@pytest.mark.parametrize("name", SKIPS)
def test_the_result_is_the_same(name):
    lean, whole = (np.asarray(jax.jit(way)(jnp.asarray(1.0))) for way in SKIPS[name][:2])
    assert np.all(np.isfinite(lean)) and np.max(np.abs(lean)) > 0.1
    np.testing.assert_allclose(whole, lean, rtol=0, atol=SOLVED if SKIPS[name].soft else SAME)

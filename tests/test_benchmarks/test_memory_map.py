"""The map of laws with a memory in short form."""

import jax
import numpy as np
import pytest

from benchmarks import memory_map

pytestmark = pytest.mark.skipif(
    np.finfo(np.longdouble).nmant < 63,
    reason="this processor's long double is no longer than double",
)


@pytest.mark.parametrize("job", [job for job in memory_map.jobs() if job[1] == "exact"])
def test_lanes_of_formulas(job):
    with jax.numpy_rank_promotion("allow"):
        row = memory_map.measure(*job, 100)
    assert row["right"] == row["lanes"] == 100

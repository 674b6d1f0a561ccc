"""The map of laws with a memory in short form, and its page."""

import json

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


def test_the_page_is_that_of_the_result():
    rows = json.loads(memory_map.RESULT.read_text())
    assert memory_map.page(rows) in memory_map.PAGE.read_text()
    assert {row["law"] for row in rows} == set(memory_map.LAWS)
    assert all(row["wrong"] == 0 for row in rows)

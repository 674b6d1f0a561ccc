"""A part of the random pendula whose touches are compared with SciPy."""

import numpy as np

from benchmarks import touches


def test_no_touch_deeper_than_a_nanometre_is_missed():
    (row,) = touches.batch(np.random.default_rng(0), 1000, (1e-9,))
    assert row["touched"] > 600 and row["free"] > 300
    assert row["missed"] == 0 and row["invented"] == 0

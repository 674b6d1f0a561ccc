"""Random mechanisms with laws of every family: energies, and derivatives of the contact table."""

from __future__ import annotations

import functools

import jax
import numpy as np
import pytest

import jaxcontact as jc
from benchmarks import random_mechanisms

EACH = 8
"""Mechanisms for each law: two that move, two at rest, two pressed, two that touch."""
LEFT_OUT = 6
"""Contacts of each law whose sequence or slope changes within the differences: at most 3 of 25."""
BOOKS = 1e-10
"""Of the energy, at rtol 1e-10. Measured 7e-12."""
SLOPES = 1e-5
"""Of derivative and value, at steps of 3e-4 and rtol 1e-10, hence 1e-10/3e-4 times the growth of a
perturbation. Measured 1.2e-6."""
READ = 3e-4
"""Of largest force and depth, whose values are read between steps. Measured 5e-5, which falls with
longer steps of the differences."""
SAME = 1e-6
"""Of numbers beside those of another program; largest depths differ by 2e-8."""


@functools.cache
def found(name):
    random = np.random.default_rng(0)
    x = random_mechanisms.drawn(random, name, EACH)
    return x, random_mechanisms.compared(name, x, random_mechanisms.directions(random, x))


@pytest.mark.parametrize(
    "name", ["HuGuo", "KelvinVoigt, no tension", "ThorntonPlastic", "Luding", "JKR"]
)
def test_derivatives_of_the_contact_table(name):
    _, runs = found(name)
    valid, sound = runs.others["valid"], runs.sound
    assert set(runs.others["status"]) <= {jc.Ending.COMPLETED, jc.Ending.TOO_MANY_IMPACTS}
    assert np.max(runs.books) < BOOKS
    assert np.sum(sound) >= 10
    assert np.sum(valid & ~sound) <= LEFT_OUT
    # A contact in progress at the end has neither.
    ends = np.isfinite(runs.table["duration"])
    np.testing.assert_array_equal(np.isfinite(runs.table["restitution"]), ends)
    for column, deviation in runs.deviation.items():
        ended = column in ("restitution", "duration")
        assert ended or np.all(np.isfinite(runs.table[column][valid]))
        compared = np.where(sound & ends if ended else sound, deviation, 0)
        assert np.max(compared) < (READ if column.startswith("max") else SLOPES), column


def test_plain_calls_give_the_same():
    """The numbers of calls from Python are those of the program."""
    x, runs = found("HuGuo")
    for k, kind in enumerate(random_mechanisms.KINDS):
        alone = random_mechanisms.simulated("HuGuo", jax.tree.map(lambda a, k=k: a[k], x))
        table, keep = alone.contacts.to_dict(), runs.others["valid"][k]
        for column in random_mechanisms.COLUMNS:
            expected = runs.table[column][k][keep]
            np.testing.assert_allclose(
                table[column], expected, rtol=SAME, err_msg=f"{kind} {column}"
            )

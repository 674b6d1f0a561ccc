"""Exports for several speeds: one set of parameters, and the range of speeds in which it holds."""

import math
import re

import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._export import export

CONTACT = jc.Contact(0.7, 3e8)
EXACT = jc.ExactRestitution(e=0.3)

# The root of the compromise: measured 1e-14.
EQUAL = 1e-11
# A straight line between the speeds of a grid: measured 7e-4.
BETWEEN = 2e-3


def test_several_speeds_have_the_least_largest_error():
    """Against every other parameter that could have been chosen, by brute force."""
    law = jc.ConstantDamping(c=3e7)
    speeds = np.array([0.5, 1.0, 2.0, 4.0])
    found = export(law, CONTACT, speeds, engine="drake")
    np.testing.assert_allclose(found.target, jc.impact(law, CONTACT, speeds).restitution)
    d = found.parameters["hunt_crossley_dissipation"]
    # Drake's e falls with speed as for this law: α = c v/K = d v.
    assert d == pytest.approx(0.1, rel=1e-6) and np.abs(found.error).max() < EQUAL
    wanted = jc.ExactRestitution(e=0.7)
    found = export(wanted, CONTACT, speeds, engine="drake")
    largest = np.abs(found.error).max()
    assert found.error.max() == pytest.approx(-found.error.min(), rel=EQUAL)
    tried = found.parameters["hunt_crossley_dissipation"] * np.linspace(0.5, 2, 301)
    e = jc.restitution(jc.Damped(alpha=jnp.asarray(tried[:, None] * speeds)))
    errors = np.abs(np.asarray(e) - 0.7).max(axis=1)
    assert largest < errors.min() * (1 + 1e-4)
    # An engine whose e does not depend on speed lies in the middle.
    found = export(law, CONTACT, speeds, engine="exudyn")
    middle = (found.target.max() + found.target.min()) / 2
    np.testing.assert_allclose(found.delivered, middle, rtol=EQUAL)
    assert "largest error of e" in repr(found)
    fast = export(
        jc.PowerDamping(c=1e7, power=-2.0, reference=1.0), CONTACT, speeds, engine="drake"
    )
    assert fast.error.max() == pytest.approx(-fast.error.min(), rel=EQUAL)


def test_over_which_speeds_an_export_holds():
    found = export(jc.ExactRestitution(e=0.7), CONTACT, 2.0, engine="drake")
    holds = found.holds(0.01)
    # Speeds at which the engine's α is that of 0.71 and of 0.69, proportional to the speed.
    alpha = [float(jc.exact_damping_factor(e)) for e in (0.71, 0.70, 0.69)]
    assert holds.low == pytest.approx(2 * alpha[0] / alpha[1], rel=BETWEEN)
    assert holds.high == pytest.approx(2 * alpha[2] / alpha[1], rel=BETWEEN)
    assert repr(holds).startswith("e is within 0.01 of the law's from 1.91 to 2.09 m/s")
    everywhere = export(jc.ExactRestitution(e=0.7), CONTACT, 2.0, engine="exudyn").holds()
    assert (everywhere.low, everywhere.high) == (0.0, math.inf)
    assert "from 0.02 (and slower) to 200 m/s (and faster)" in repr(everywhere)
    nowhere = export(jc.ExactRestitution(e=0.7), CONTACT, [0.1, 10.0], engine="drake").holds(1e-4)
    assert math.isnan(nowhere.low)
    first, *rows = repr(nowhere).splitlines()
    assert first == "e is within 0.0001 of the law's at no speed around 1 m/s, that of the export"
    assert "nan" not in repr(nowhere) and len(rows) == 10


@pytest.mark.parametrize(
    ("speeds", "message"),
    [
        (None, "`velocity` is needed without a calibration"),
        ([[1.0, 2.0]], "one speed, or several of the shape (n,), but has the shape (1, 2)"),
        ([1.0, -2.0], "at -2 m/s its impact ended as 'invalid_input'"),
    ],
)
def test_speeds_that_cannot_be(speeds, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        export(EXACT, CONTACT, speeds, engine="drake")

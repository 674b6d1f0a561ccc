"""The phase-angle method: correct where it is not flagged."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_impact.support import UNIT, assert_within, column, errors_of, family

# Range in which every published law of the family has e ≥ 0.1, with n = 3/2; measured 4.6e-10.
PROMISE = 1e-9
LARGEST_ALPHA = 14.4
# The force and the turn come from the same steps; measured 3.1e-10.
TOLERANCES = dict.fromkeys(
    ("e", "duration", "compression_time", "max_indentation", "max_force"), PROMISE
)
# Below this the error and its estimate are rounding.
ROUNDING = 1e-14
# Measured 190 to 14000 where the error is above 1e-11.
MOST_CAUTIOUS = 1e5


def hunt_crossley(**options):
    some, alpha, law = family("hunt_crossley", n=1.5)
    return jc.impact(law(alpha), UNIT[1.5], 1.0, method=jc.Phase(**options)), some


def true_error(hit, some):
    error = errors_of(hit, some)
    return np.maximum(error["e"], error["duration"])


def assert_honest(hit, some):
    """Separated lanes: error ≤ estimate, and not a wild guess; the others: NaN and a flag."""
    good = np.asarray(hit.status == jc.Status.SEPARATED)
    estimate, error = np.asarray(hit.error_estimate)[good], true_error(hit, some)[good]
    assert (error <= np.maximum(estimate, ROUNDING)).all()
    assert (estimate <= MOST_CAUTIOUS * error)[error > 1e-11].all()
    assert (hit.status[~good] == jc.Status.NOT_CONVERGED).all()
    assert np.isnan(hit.restitution[~good]).all() and np.isnan(hit.duration[~good]).all()


def test_hunt_crossley_down_to_a_restitution_of_a_tenth():
    hit, some = hunt_crossley()
    alpha = np.asarray(column(some, "alpha"))
    right = alpha <= LARGEST_ALPHA
    assert (hit.status[right] == jc.Status.SEPARATED).all()
    error = {f: x[right] for f, x in errors_of(hit, some).items()}
    assert_within(error, TOLERANCES, alpha[right])
    assert (hit.status[alpha >= 100] == jc.Status.NOT_CONVERGED).all()
    assert_honest(hit, some)
    assert hit.method == "phase" and (hit.steps == 32).all()


HONEST = [
    *(("hunt_crossley", {"n": n}, 5.0, 100.0) for n in (1.0, 2.0)),
    # Flagged where the angle turns back.
    ("kuwabara_kono", {"tension": True}, 0.6, 1.5),
    *(("oscillator", {"ending": "tension", "n": n}, 0.1, np.inf) for n in (1.0, 1.5)),
]


@pytest.mark.parametrize(("kind", "fixed", "converged", "flagged"), HONEST, ids=str)
def test_others_are_honest(kind, fixed, converged, flagged):
    some, numbers, law = family(kind, **fixed)
    contact = jc.Contact(1.0, 1.0, fixed.get("n", 1.5))
    hit = jc.impact(law(numbers), contact, 1.0, method="phase")
    assert_honest(hit, some)
    assert (hit.status[numbers <= converged] == jc.Status.SEPARATED).all()
    assert (hit.status[numbers >= flagged] == jc.Status.NOT_CONVERGED).all()


def test_fewer_steps_are_worse_and_know_it():
    coarse, some = hunt_crossley(steps=16, tolerance=1e-3)
    assert_honest(coarse, some)
    fine, _ = hunt_crossley()
    assert (true_error(coarse, some) > 10 * true_error(fine, some))[:8].all()


# Against closed forms: measured 1.1e-8, for Jankowski's e 3.3e-8. Below e = 0.72 (Jankowski: 0.33)
# they are flagged.
OSCILLATORS = 5e-8


@pytest.mark.parametrize("law", [jc.AntypovElliott, jc.Tsuji, jc.Jankowski])
def test_oscillators_of_hertz_contacts(law):
    e = jnp.linspace(0.1, 1, 100)
    hit, exact = (jc.impact(law(e=e), UNIT[1.5], 1.0, method=m) for m in ("phase", "exact"))
    good = np.asarray(hit.status == jc.Status.SEPARATED)
    assert good[e > 0.73].all()
    for name in ("restitution", "duration"):
        known = getattr(exact, name)[good]
        np.testing.assert_allclose(getattr(hit, name)[good], known, rtol=OSCILLATORS)


def test_the_tolerance_decides_what_counts_as_converged():
    strict, _ = hunt_crossley(tolerance=1e-8)
    assert (strict.status == jnp.where(strict.error_estimate <= 1e-8, 0, 2)).all()
    assert 0 < (strict.status == 0).sum() < strict.status.size

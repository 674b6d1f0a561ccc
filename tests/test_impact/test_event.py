"""The event-terminated solve, for every form of force, against forty digits."""

import diffrax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle import FIELDS
from tests.test_impact.support import UNIT, assert_within, column, errors_of, family, grid, values

# At the default rtol of 1e-9; measured 2.1e-9 for the loss, 1.3e-9 for the rest. n = 1 has the
# largest errors, 1.3e-8 for the energy loss.
PROMISE = 1e-8
ALL = dict.fromkeys(FIELDS, PROMISE)
OTHER_EXPONENTS = ALL | {"energy_loss": 2 * PROMISE}
MOST_STEPS = 128
# Overdamped contacts without tension: measured 218.
CREEPING_STEPS = 256


def assert_solved(hit, some, tolerances, numbers):
    assert hit.method == "event"
    assert (hit.status == jc.Status.SEPARATED).all()
    assert_within(errors_of(hit, some), tolerances, numbers)


# Of Kvaerno5, whose interpolant of order 5 would require another safety factor: measured 1.1e-8.
# The momentum of strong damping is solved relative to its own size, at the cost of rejected
# implicit steps. 1024 steps are too few from α = 100 on; 1536 measured sufficient.
STIFF = 3e-8
SOLVERS = {
    "own": ({}, PROMISE, "the library's own loop with Dopri8's"),
    "other": ({"solver": diffrax.Tsit5()}, PROMISE, "diffrax.diffeqsolve with Tsit5"),
    "stiff": ({"solver": diffrax.Kvaerno5(), "max_steps": 2048}, STIFF, "diffrax.diffeqsolve"),
}


@pytest.mark.slow("other", "stiff", reason="solvers of another order, whose programs are their own")
@pytest.mark.parametrize("name", SOLVERS)
def test_hunt_crossley_at_any_damping(name):
    options, tolerance, words = SOLVERS[name]
    some, alpha, law = family("hunt_crossley", n=1.5)
    hit = jc.impact(law(alpha), UNIT[1.5], 1.0, method=jc.Event(**options))
    assert_solved(hit, some, dict.fromkeys(ALL, tolerance), alpha)
    assert repr(hit).startswith(f"Impact by method 'event', {words}")
    if name == "own":
        # The coordinates remove the stiffness: the steps hardly depend on α.
        assert hit.steps.max() <= MOST_STEPS
        assert 10 * hit.steps.max() <= 17 * hit.steps.min()


FORCES = [
    *(("hunt_crossley", {"n": n}) for n in (1.0, 1.25, 2.0, 3.0)),
    *(("kuwabara_kono", {"tension": tension}) for tension in (True, False)),
    *(("oscillator", {"ending": end, "n": 1.5}) for end in ("tension", "clamped", "approach")),
    *(("oscillator", {"ending": end, "n": 1.0}) for end in ("tension", "clamped")),
]


@pytest.mark.parametrize(("kind", "fixed"), FORCES, ids=str)
def test_other_forces(kind, fixed):
    some, numbers, law = family(kind, **fixed)
    n = fixed.get("n", 1.5)
    if (kind, n) == ("oscillator", 1.0):
        some, numbers = [c for c in some if c.args["zeta"] < 1.4], numbers[numbers < 1.4]
    hit = jc.impact(law(numbers), jc.Contact(1.0, 1.0, n), 1.0, method="event")
    tolerances = OTHER_EXPONENTS if kind == "hunt_crossley" else ALL
    assert_solved(hit, some, tolerances, numbers)
    # Overdamped contacts without tension end where forces cancel throughout restitution.
    moderate = np.asarray(numbers <= (1 if kind == "oscillator" else np.inf))
    assert hit.steps[moderate].max() <= MOST_STEPS and hit.steps.max() <= CREEPING_STEPS


# For A = 5, where the force pulls back, e is 0.02: measured 1.4e-8 of that.
UNKNOWN_FORCE = 3e-8


class Viscoelastic(jc.AbstractLaw):
    """Kuwabara and Kono's force as a user would write it, unknown to the solver."""

    A: jnp.ndarray
    tension = True

    def force(self, indentation, velocity, contact, impact_velocity):
        root = jnp.sqrt(jnp.where(indentation > 0, indentation, 0))
        return contact.stiffness * (root * indentation + 1.5 * self.A * root * velocity)


def test_a_law_of_the_users():
    some, a, _ = family("kuwabara_kono", tension=True)
    hit = jc.impact(Viscoelastic(A=a), UNIT[1.5], 1.0)
    assert_solved(hit, some, ALL | {"e": UNKNOWN_FORCE}, a)


def test_a_traced_exponent():
    some = [c for c in grid("hunt_crossley") if c.args["alpha"] in (0, 0.3, 20, 1e6)]
    alpha, n = column(some, "alpha"), column(some, "n")
    hit = jc.impact(jc.Damped(alpha=alpha), jc.Contact(1.0, 1.0, n), 1.0, method="event")
    assert_solved(hit, some, OTHER_EXPONENTS, alpha)


def test_si_units_change_nothing_but_the_units():
    some, alpha, law = family("hunt_crossley", n=1.5)
    stiffness, mass, velocity = 3.7e9, 2.5e-4, 0.031
    hit = jc.impact(law(alpha), jc.Contact(mass, stiffness), velocity, method="event")
    length = (mass * velocity**2 / stiffness) ** 0.4
    assert np.allclose(hit.restitution, values(some)["e"], rtol=PROMISE, atol=0)
    duration = values(some)["duration"] * length / velocity
    assert np.allclose(hit.duration, duration, rtol=PROMISE, atol=0)

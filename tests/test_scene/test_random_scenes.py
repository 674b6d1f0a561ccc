"""Random discs in a box under gravity, against Newton's equations.

The answers are stored (``tests/oracle/random_scenes.py``); ``benchmarks/random_scenes.py`` compares
all of them.
"""

import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.random_scenes import ALIKE, DURATION, GRAVITY, LAWS, answers, drawn

WITHIN = 0.2
"""Of `rtol` times the growth of a perturbation. Measured: 4e-3 at 1e-6, 0.15 at 1e-9."""
ESTIMATED = 10
"""The error beside what the impacts estimate, times that growth. Measured: 0.011."""
SAME = 1e-10
"""Of a run in other units, times the growth. Measured: 1e-15."""


def simulated(given, rtol, length=1.0, time=1.0, mass=1.0):
    """The run, in units of which a metre, a second and a kilogram have so many; positions and
    velocities at its end in SI units.
    """
    law = jc.get_law(given.law, e=given.number) if given.law != "kuwabara_kono" else None
    if given.law in ("hunt_crossley", "flores"):
        # One program for both.
        law = jc.Damped(alpha=given.damping["alpha"])
    discs = [
        jc.Sphere(
            b.radius * length,
            b.mass * mass,
            [x * length for x in b.position],
            [x * length / time for x in b.velocity],
        )
        for b in given.balls
    ]
    run = jc.simulate(
        jc.Scene(
            [*discs, jc.Box([0.0, 0.0], [length, length])],
            law or jc.KuwabaraKono(A=given.number * time),
            stiffness=given.stiffness * mass / time**2 / length ** (given.exponent - 1),
            exponent=given.exponent,
            gravity=[x * length / time**2 for x in GRAVITY],
        ),
        DURATION * time,
        rtol=rtol,
    )
    assert run.status == jc.Ending.COMPLETED
    return run, run.position[-1] / length, run.velocity[-1] * time / length


def agrees(number, rtol):
    known, (run, position, velocity) = answers()[str(number)], simulated(drawn(number), rtol)
    error = np.abs(np.subtract([position, velocity], [known["position"], known["velocity"]])).max()
    impacts = run.impacts.to_dict()
    # A disc that comes to rest may open and close once more by rounding.
    assert len(impacts["time"]) >= known["touches"]
    assert error <= WITHIN * rtol * known["growth"], number
    estimate = np.sum(impacts["error_estimate"] * impacts["closing_speed"])
    assert error <= ESTIMATED * estimate * known["growth"], number


def test_fifty_scenes_end_where_newtons_equations_do():
    """By one program: four discs, and Hunt and Crossley's family."""
    for turn, number in enumerate(ALIKE):
        agrees(number, (1e-6, 1e-9)[turn % 2])


@pytest.mark.slow(reason="ten random soft scenes, each a program")
@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
@pytest.mark.parametrize("law", LAWS)
def test_every_law(law, rtol):
    """Three scenes of three discs, and three of four."""
    first = LAWS.index(law)
    for number in range(first, 30, len(LAWS)):
        agrees(number, rtol)


def test_units_do_not_matter():
    """Closing speeds of 1e-9 and 1e-12 m/s, and of 1e9."""
    for number in ALIKE[:4]:
        known = simulated(drawn(number), 1e-6)[1:]
        for length, time, mass in ((1e-3, 1e6, 1e-9), (1e-3, 1e9, 1e-9), (1e3, 1e-6, 1e9)):
            found = simulated(drawn(number), 1e-6, length, time, mass)[1:]
            most = SAME * answers()[str(number)]["growth"]
            np.testing.assert_allclose(found, known, rtol=0, atol=most)

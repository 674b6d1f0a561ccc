"""Random starts: no overlaps, repeatable, of the promised density, and in thermal equilibrium.

Random discs in a box under gravity, against Newton's equations. The answers are stored
(``tests/oracle/random_scenes.py``); ``benchmarks/random_scenes.py`` compares more of them.
"""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.random_scenes import ALIKE, DURATION, GRAVITY, LAWS, answers, drawn
from tests.test_scene.support import in_a_line, spheres

ROUNDING = 1e-12


def arrays(spheres):
    position = np.array([sphere.position for sphere in spheres])
    return position, np.array([float(sphere.radius) for sphere in spheres])


def least_gap(spheres, low, high, periodic):
    """The smallest distance of two surfaces, or of one and a wall."""
    position, radius = arrays(spheres)
    around = np.array([length is not None for length in periodic])
    size = np.asarray(high) - low
    i, j = np.triu_indices(len(radius), 1)
    apart = position[i] - position[j]
    apart = np.where(around, apart - size * np.round(apart / size), apart)
    gaps = np.sqrt(np.sum(apart**2, axis=-1)) - radius[i] - radius[j]
    walls = np.minimum(position - low, high - position) - radius[:, None]
    return min(np.min(gaps), np.min(walls[:, ~around], initial=np.inf))


CASES = {
    "line": (18, [0.0], [2.0], 0.04, None),
    "ring": (18, [-1.0], [1.0], 0.04, (2.0,)),
    "discs": (120, [0.0, 1.0], [1.0, 3.0], 0.045, None),
    "channel": (60, [0.0, 0.0], [1.0, 1.0], 0.045, (1.0, None)),
    "balls": (60, [0.0, 0.0, 0.0], [1.0, 1.0, 1.0], 0.08, None),
    "torus": (100, [0.0, 0.0, 0.0], [1.0, 1.0, 1.0], 0.09, (1.0, 1.0, 1.0)),
    "two sizes": (60, [0.0, 0.0], [1.0, 1.0], [0.09] * 5 + [0.02] * 55, None),
    "rows": (225, [0.0, 0.0], [1.0, 1.0], 0.032, None),
    "rows around": (512, [0.0] * 3, [1.0] * 3, 0.06, (1.0, None, 1.0)),
}


@pytest.mark.parametrize("case", CASES)
def test_nothing_overlaps(case):
    count, low, high, radius, periodic = CASES[case]
    given = {"low": low, "high": high, "radius": radius, "mass": 1.0, "periodic": periodic}
    spheres = jc.random_spheres(count, **given)
    assert len(spheres) == count
    assert least_gap(spheres, low, high, periodic or (None,) * len(low)) > 0
    np.testing.assert_array_equal(arrays(spheres)[1], np.broadcast_to(radius, (count,)))
    position = arrays(spheres)[0]
    np.testing.assert_array_equal(position, arrays(jc.random_spheres(count, **given))[0])
    assert np.all(position != arrays(jc.random_spheres(count, **given, seed=1))[0])
    jc.Scene([*spheres, *([] if periodic else [jc.Box(low, high)])], jc.Hertz(), periodic=periodic)


def test_places_are_spread_evenly():
    """Thin spheres are independent: means and variances are those of even numbers."""
    spheres = jc.random_spheres(400, low=[0.0, 2.0], high=[1.0, 4.0], radius=1e-4, mass=1.0)
    place = (arrays(spheres)[0] - [0.0, 2.0]) / [1.0, 2.0]
    # Four standard errors.
    np.testing.assert_allclose(place.mean(axis=0), 0.5, atol=4 / np.sqrt(12 * 400))
    np.testing.assert_allclose(place.var(axis=0), 1 / 12, atol=4 / np.sqrt(180 * 400))
    # Rows leave no order in the numbering of the spheres.
    rows = jc.random_spheres(225, low=[0.0, 0.0], high=[1.0, 1.0], radius=0.032, mass=1.0)
    along = np.corrcoef(np.arange(225), arrays(rows)[0][:, 0])[0, 1]
    assert abs(along) < 4 / np.sqrt(225)


def test_a_wide_box_is_filled_as_promised():
    """45 % in two dimensions, 30 % in three, at random: no rows are needed."""
    area = jc.random_spheres(573, low=[0.0, 0.0], high=[1.0, 1.0], radius=0.0158, mass=1.0)
    assert np.sum(np.pi * arrays(area)[1] ** 2) > 0.449
    volume = 4 / 3 * np.pi * 0.06**3
    around = (1.0, 1.0, 1.0)
    given = {"low": [0.0] * 3, "high": around, "radius": 0.06, "periodic": around}
    balls = jc.random_spheres(int(np.ceil(0.3 / volume)), **given, mass=1.0)
    for drawn_ones, cells in ((area, 31), (balls, 8)):
        place, radius = arrays(drawn_ones)
        # In rows, every sphere would be inside a cell.
        inside = np.mod(place * cells, 1)
        margin = radius[:, None] * cells
        assert np.any(inside < margin)


def test_thermal_velocities():
    mass = np.repeat([1.0, 4.0], 500)
    spheres = jc.random_spheres(
        1000, low=[0.0, 0.0], high=[1.0, 1.0], radius=1e-3, mass=mass, speed=3.0, name="gas"
    )
    velocity = np.array([sphere.velocity for sphere in spheres])
    scale = np.sum(mass) * 3.0
    np.testing.assert_allclose(mass @ velocity, 0, atol=ROUNDING * scale)
    energy = mass * np.sum(velocity**2, axis=1) / 2
    np.testing.assert_allclose(np.sum(energy), np.sum(mass) * 9 / 2, rtol=ROUNDING)
    # Light and heavy spheres share the energy: four standard errors of 500 exponential numbers.
    light, heavy = np.mean(energy[:500]), np.mean(energy[500:])
    assert abs(light / heavy - 1) < 4 * np.sqrt(2 / 500)
    assert {sphere.name for sphere in spheres} == {"gas"}
    assert [float(sphere.mass) for sphere in spheres[499:501]] == [1.0, 4.0]


def test_masses_by_density():
    steel = jc.Material(2.1e11, 0.3, 7800.0)
    radius = [0.01, 0.02, 0.03]
    spheres = jc.random_spheres(
        3, low=[0.0] * 3, high=[1.0] * 3, radius=radius, material=steel, speed=1.0
    )
    assert all(sphere.mass is None for sphere in spheres)
    mass = np.array([float(sphere.known_mass()) for sphere in spheres])
    momentum = mass @ np.array([sphere.velocity for sphere in spheres])
    np.testing.assert_allclose(momentum, 0, atol=ROUNDING)
    at_rest = jc.random_spheres(2, low=[0.0], high=[1.0], radius=0.1, mass=1.0)
    assert at_rest[0].velocity is None


GOOD = {"low": [0.0, 0.0], "high": [1.0, 1.0], "radius": 0.1, "mass": 1.0}
FAULTS = {
    "too many": (
        {"count": 40},
        "`count` must be one that fits into the box, but is 40: they would fill 1.26 of it; at "
        "random ",
    ),
    "too large": (
        {"radius": 0.6},
        "`radius` must be at most half of the box, which is 1 × 1 m, but the largest is 0.6",
    ),
    "mass": ({"mass": [1.0, 1.0, 0.0]}, "`mass` must be a number in (0, inf), or 3 of them"),
    "no mass": ({"mass": None}, "`mass` must be given for spheres without a material"),
    "open": ({"high": [1.0, np.inf]}, "`high` must be finite numbers"),
    "order": ({"high": [1.0, 0.0]}, "`high` must be above `low` = [0.0, 0.0]"),
    "alone": ({"count": 1, "speed": 1.0}, "`speed` must be None for a single sphere"),
    "period": (
        {"periodic": (2.0, None)},
        "`periodic` must be None or the length of the box, 1 along axis 0",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_bad_arguments(fault):
    given, words = FAULTS[fault]
    with pytest.raises(ValueError, match=re.escape(words)):
        jc.random_spheres(**({"count": 3} | GOOD | given))


WITHIN = 0.2  # of `rtol` times the growth of a perturbation. Measured: 4e-3 at 1e-6, 0.15 at 1e-9.
ESTIMATED = 10  # the error beside what the impacts estimate, times that growth. Measured: 0.011.
SAME = 1e-10  # of a run in other units, times the growth. Measured: 1e-15.


def simulated(given, rtol, length=1.0, time=1.0, mass=1.0):
    """The run, in units of which a metre, a second and a kilogram have so many; positions and
    velocities at its end in SI units.
    """
    if given.law == "kuwabara_kono":
        law = jc.KuwabaraKono(A=given.number * time)
    elif given.law in ("hunt_crossley", "flores"):
        # One program for both.
        law = jc.Damped(alpha=given.damping["alpha"])
    else:
        law = jc.get_law(given.law, e=given.number)
    rows = [(b.radius, b.mass, b.position, b.velocity) for b in given.balls]
    radius, masses, place, speed = (np.array(column) for column in zip(*rows, strict=True))
    discs = spheres(radius * length, masses * mass, place * length, speed * length / time)
    scene = jc.Scene(
        [*discs, jc.Box([0.0, 0.0], [length, length])], law, exponent=given.exponent,
        stiffness=given.stiffness * mass / time**2 / length ** (given.exponent - 1),
        gravity=[x * length / time**2 for x in GRAVITY],
    )  # fmt: skip
    run = jc.simulate(scene, DURATION * time, rtol=rtol)
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


def test_a_step_back_to_the_touch_leaves_a_sound_clock():
    """The peak of a dashpot's speed is its touch. The first step from there was NaN."""
    for number in (4, 24, 34):
        agrees(number, 1e-9)


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
    for number in ALIKE[:2]:
        known = simulated(drawn(number), 1e-6)[1:]
        for length, time, mass in ((1e-3, 1e6, 1e-9), (1e-3, 1e9, 1e-9), (1e3, 1e-6, 1e9)):
            found = simulated(drawn(number), 1e-6, length, time, mass)[1:]
            most = SAME * answers()[str(number)]["growth"]
            np.testing.assert_allclose(found, known, rtol=0, atol=most)


class Driven(jc.AbstractLaw):
    """A law that adds energy for a positive `gain` in s/m."""

    gain: jax.Array
    tension: bool = False

    def force(self, indentation, velocity, contact, impact_velocity):
        return contact.stiffness * indentation**1.5 * (1 - self.gain * velocity)


def run(gain, **how):
    balls = in_a_line(0.1, 1.0, [0.0, 0.3], [1.0, 0.0])
    scene = jc.Scene(balls, Driven(jnp.asarray(gain)), stiffness=1e5)
    return jc.simulate(scene, 0.5, progress=False, **how)


@pytest.mark.parametrize("instantaneous", [True, False])
def test_a_run_that_gains_energy_is_flagged(instantaneous):
    how = {"instantaneous": instantaneous, "throw": False}
    # A millionth of the energy is more than the error of the impact, and a loss is none.
    gains = {0.1: "GAINED", 1e-6: "GAINED", 0.0: "COMPLETED", -0.1: "COMPLETED"}
    for gain, status in gains.items():
        found = run(gain, **how)
        assert jc.Ending(int(found.status)).name == status, gain
        assert bool(found.ok) == (status == "COMPLETED")
    # The values hold up to the end.
    gained = run(0.1, **how)
    assert gained.reached == 0.5 and np.isfinite(gained.position).all()
    np.testing.assert_allclose(gained.energy[0] - gained.energy[-1], gained.impacts.energy_loss[0])
    with pytest.raises(jc.NumericalError, match=r"`simulate` failed: GAINED\. An impact adds"):
        run(0.1, instantaneous=instantaneous)

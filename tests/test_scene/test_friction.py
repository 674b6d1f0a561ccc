"""Scenes with friction: impacts, angular momentum, energy, symmetry, sliding and rolling."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_scene.support import go, missing, spheres

ROUNDING = 2e-14
"""Momentum, angular momentum and energy of an instantaneous impact, relative: measured 3e-15."""

FORMULA = 1e-12
"""Times, speeds and spins beside formulas and event-driven integrations: measured 2e-14."""

ENERGY = 1e-12
"""Energy over a run with a summed series, sliding and a belt, relative: measured 1e-14."""

G = 9.8
LAWS = {
    "rigid": jc.RigidCoulomb(mu=0.25),
    "walton": jc.WaltonFriction(mu=0.25, beta0=0.5),
    "regularized": jc.RegularizedCoulomb(mu=0.25, v_d=0.05),
}


def pairs(numbers):
    """Spheres in space, two for each law, of which two may meet."""
    names = [name for name in LAWS for _ in range(2)]
    friction = {(name, name): law for name, law in LAWS.items()} | {"default": LAWS["rigid"]}
    law = jc.ExactRestitution(e=0.7)
    return jc.Scene(spheres(*numbers, names), law, friction=friction, stiffness=1e8)


def random_pairs(count):
    """Spheres that meet within a second: one is aimed at a point of the other."""
    random = np.random.default_rng(7)
    radius = random.uniform(0.05, 0.15, (count, 2))
    mass, spin = random.uniform(0.2, 2, (count, 2)), random.normal(size=(count, 2, 3)) * 20
    place = random.normal(size=(count, 2, 3)) * 0.1
    away = random.normal(size=(count, 3))
    place[:, 1] = place[:, 0] + away / np.linalg.norm(away, axis=1, keepdims=True)
    aim = place[:, 0] + random.uniform(-0.5, 0.5, (count, 3)) * radius.sum(1, keepdims=True)
    velocity = np.zeros((count, 2, 3))
    velocity[:, 1] = 2 * (aim - place[:, 1])
    velocity += random.normal(size=(count, 1, 3))
    return radius, mass, place, velocity, spin


def angular(radius, mass, position, velocity, spin):
    inertia = 0.4 * mass * radius**2
    orbital = mass[..., None] * np.cross(position, velocity)
    return np.sum(orbital + inertia[..., None] * spin, axis=-2)


ALONG = np.array([[1.0, 0, 0], [-1.0, 0, 0]])
# Equal spheres that meet head-on with opposite spins about the line of centres.
HEAD_ON = [0.1, 0.1], [1.0, 1.0], [[0.0, 3, 0], [1.0, 3, 0]], ALONG, 5 * ALONG


@pytest.fixture(scope="module")
def met():
    """A thousand random pairs, and that one; and what becomes of them by each law."""
    numbers = [np.append(x, [y], 0) for x, y in zip(random_pairs(1000), HEAD_ON, strict=True)]
    # All other spheres of a scene are far away.
    far = np.arange(1.0, 5)[:, None] * [1e3, 0, 0]
    rest = np.full(4, 0.1), np.ones(4), far, 0 * far, 0 * far
    six = [np.append(x, [y] * len(x), 1) for x, y in zip(numbers, rest, strict=True)]

    @jax.jit
    @jax.vmap
    def run_of(numbers):
        run = go(pairs(numbers), 1.0, max_impacts=2)
        lost = jnp.sum(jnp.where(run.impacts.valid, run.impacts.energy_loss, 0))
        return (run.position, run.velocity, run.spin), run.energy, lost, run.impacts.valid[0]

    def by_law(k):
        motion, *sums = run_of(tuple(jnp.asarray(np.roll(x, 2 * k, 1)) for x in six))
        return *(np.asarray(x)[:, :, 2 * k : 2 * k + 2] for x in motion), *map(np.asarray, sums)

    return numbers, {name: by_law(k) for k, name in enumerate(LAWS)}


@pytest.mark.parametrize("name", LAWS)
def test_a_thousand_pairs_keep_their_angular_momentum(name, met):
    (radius, mass, *_), found = met
    position, velocity, spin, energy, lost, hit = found[name]
    assert np.sum(hit) > 900
    before, after = (
        angular(radius, mass, *(x[:, k] for x in (position, velocity, spin))) for k in (0, 1)
    )
    parts = mass[..., None] * np.abs(np.cross(position[:, 0], velocity[:, 0]))
    size = np.max(parts, axis=(1, 2)) + np.max(np.abs(before), axis=1)
    assert np.max(np.abs(after - before) / size[:, None]) < ROUNDING
    momentum = np.sum(mass[..., None, None] * (velocity[:, 1] - velocity[:, 0])[..., None], axis=1)
    assert np.max(np.abs(momentum)) < ROUNDING * 10
    balance = energy[:, 0] - energy[:, 1] - lost
    assert np.max(np.abs(balance) / energy[:, 0]) < ROUNDING
    # Friction never creates energy.
    assert np.all(lost > 0)
    # Spin about the normal is kept.
    assert hit[-1]
    np.testing.assert_array_equal(spin[-1, 1], 5 * ALONG)


def rigid(v, w, normal, closing, mu, e, beta, radius=0.1, lever=2.5):
    """Walton's rebound of a ball in the plane, written out: v in m/s, w in rad/s."""
    tangent = np.array([-normal[1], normal[0]])
    # The contact point is at -R n from the centre.
    slip = v @ tangent - radius * w
    mobility = 1 + lever
    size = abs(slip)
    after = max(size - mobility * mu * (1 + e) * closing, -beta * size)
    change = np.sign(slip) * (after - size) / mobility
    v = v + (1 + e) * closing * normal + change * tangent
    return v, w - lever * change / radius, slip


@pytest.mark.parametrize(("spin", "mu"), [(60.0, 0.4), (-60.0, 0.9)])
def test_a_ball_that_spins_down_a_shell(spin, mu):
    """Bounces inside a circle under gravity, beside flights whose ends are roots of a quartic: all
    normals, slip in both directions.
    """
    e, beta, inner, pull = 0.8, 0.3, 0.9, np.array([0.0, -G])
    x, v, w, left, times, slips = np.array([-0.6, 0.3]), np.zeros(2), spin, 1.6, [], []
    bodies = jc.Sphere(0.1, 0.5, x, v, spin=w), jc.Shell([0.0, 0.0], inner + 0.1)
    friction = jc.WaltonFriction(mu=mu, beta0=beta)
    run = go(jc.Scene(bodies, jc.ExactRestitution(e=e), gravity=pull, friction=friction), left)
    while True:
        quartic = [pull @ pull / 4, v @ pull, v @ v + x @ pull, 2 * x @ v, x @ x - inner**2]
        roots = np.roots(quartic)
        dt = min(x.real for x in roots if abs(x.imag) < 1e-9 and x.real > 1e-7)
        for _ in range(3):
            dt -= np.polyval(quartic, dt) / np.polyval(np.polyder(quartic), dt)
        dt = min(dt, left)
        x, v, left = x + v * dt + pull * dt**2 / 2, v + pull * dt, left - dt
        if left == 0:
            break
        v, w, slip = rigid(v, w, -x / inner, v @ x / inner, mu, e, beta)
        times.append(1.6 - left)
        slips.append(slip)
    assert len(times) == len(run.impacts) >= 3 and min(slips) < 0 < max(slips)
    # Each bounce doubles an error or so.
    within = 100 * FORMULA
    np.testing.assert_allclose(run.impacts.time, times, rtol=within)
    np.testing.assert_allclose(run.position[-1, 0], x, atol=within)
    np.testing.assert_allclose(run.velocity[-1, 0], v, atol=10 * within)
    np.testing.assert_allclose(run.spin[-1, 0], w, rtol=10 * within)


def on_a_belt(
    v, w=0.0, *, height=0.1, e=0.5, mu=0.3, slope=0.0, drift=(0.0, 0.0), normal=(0.0, 1.0), pull=G
):
    """A ball on a belt, which may stand."""
    ball = jc.Sphere(0.1, 0.5, [0.0, height], v, spin=w)
    belt = jc.Plane([0.0, 0.0], normal, motion=jc.Steady(drift))
    gravity = pull * np.array([np.sin(slope), -np.cos(slope)])
    law, friction = jc.ExactRestitution(e=e), jc.RigidCoulomb(mu=mu)
    return jc.Scene([ball, belt], law, gravity=gravity, friction=friction)


def test_a_ball_slides_and_then_rolls():
    """From 2 v0/(7 μ g) on it rolls at ω = 5 v0/(7 R)."""
    v0, mu, radius = 2.0, 0.3, 0.1
    begins = 2 * v0 / (7 * mu * G)
    times = np.array([0.0, 0.5 * begins, begins * (1 - 1e-9), begins * (1 + 1e-9), 1.0, 2.0])
    run = go(on_a_belt([v0, 0.0]), 2.0, times=times)
    speed = np.where(times < begins, v0 - mu * G * times, 5 / 7 * v0)
    spin = np.where(times < begins, -2.5 * mu * G * times / radius, -5 / 7 * v0 / radius)
    np.testing.assert_allclose(run.velocity[:, 0, 0], speed, atol=FORMULA)
    np.testing.assert_allclose(run.spin[:, 0], spin, atol=10 * FORMULA)
    place = v0 * begins - mu * G * begins**2 / 2 + 5 / 7 * v0 * (2 - begins)
    assert abs(run.position[-1, 0, 0] - place) < FORMULA
    assert len(run.impacts) == 1  # the touch at time zero; rolling is not an impact
    assert run.status == jc.Ending.COMPLETED


MILD, STEEP = 5 / 7 * G * np.sin(0.2), 0.3 * G * np.cos(1.0)


@pytest.mark.parametrize(
    ("how", "duration", "speed", "spin"),
    [
        # A rolling ball goes down with 5/7 of the pull, one on a steep slope slides.
        ({"v": [0.0, 0.0], "slope": 0.2}, 1.0, MILD, -MILD / 0.1),
        ({"v": [0.0, 0.0], "slope": 1.0}, 1.0, G * np.sin(1.0) - STEEP, -2.5 * STEEP / 0.1),
        # It turns round.
        ({"v": [1.0, 0.0], "w": 80.0}, 2.0, (5 - 2 * 8) / 7, (2 * 8 - 5) / 0.7),
        # At rest, and rolling relative to a wall that moves along itself.
        ({"v": [0.0, 0.0], "drift": [1.4, 0.0]}, 1.0, 0.4, (1.4 - 0.4) / 0.1),
    ],
    ids=["mild slope", "steep slope", "backspin", "belt"],
)
def test_what_rolls_and_slides(how, duration, speed, spin):
    run = go(on_a_belt(**how), duration)
    np.testing.assert_allclose(run.velocity[-1, 0], [speed, 0.0], rtol=FORMULA, atol=FORMULA)
    np.testing.assert_allclose(run.spin[-1, 0], spin, rtol=FORMULA)


def test_a_moving_wall_gives_sliding_speed_and_does_work():
    scene = on_a_belt([0.0, -2.0], height=0.5, e=0.6, mu=0.1, drift=[3.0, 0.5], pull=0.0)
    run = go(scene, 0.5)
    np.testing.assert_allclose(run.velocity[-1, 0, 0], 0.1 * 1.6 * 2.5, rtol=FORMULA)
    assert missing(run) < FORMULA


def test_periodic_cells():
    """A pair that meets across the border of a cell, beside the same pair inside."""

    def scene(shift):
        place, speed = [[(0.5 + shift) % 2.0, 0.5], [(1.1 + shift) % 2.0, 0.6]], [[1.0, 0.2]]
        balls = spheres(0.1, 0.5, place, [*speed, [-1.0, 0.0]], [4.0, -9.0])
        law, friction = jc.ExactRestitution(e=0.7), LAWS["rigid"]
        return jc.Scene(balls, law, friction=friction, periodic=[2.0, None])

    inside, across = (go(scene(shift), 0.5) for shift in (0.0, 1.2))
    assert len(across.impacts) == 1
    np.testing.assert_allclose(across.velocity[-1], inside.velocity[-1], atol=FORMULA)
    np.testing.assert_allclose(across.spin[-1], inside.spin[-1], atol=10 * FORMULA)


def test_a_cue_ball_with_follow():
    """It stops at the object ball, slides by its spin and rolls after it; both without friction
    between the balls.
    """
    mu, v0, radius = 0.2, 2.0, 0.03
    place, speed = [[0.0, radius, 0.0], [0.5, radius, 0.0]], [[v0, 0.0, 0.0], None]
    spin = [[0.0, 0.0, -v0 / radius], None]
    table = jc.Plane([0.0, 0.0, 0.0], [0.0, 1.0, 0.0], name="table")
    scene = jc.Scene(
        [*spheres(radius, 0.17, place, speed, spin, ["cue", "object"]), table],
        {("cue", "object"): jc.ExactRestitution(e=0.9), "default": jc.ExactRestitution(e=0.5)},
        gravity=[0.0, -G, 0.0],
        friction={("cue", "object"): jc.RigidCoulomb(0.0), "default": jc.RigidCoulomb(mu)},
    )
    run = go(scene, 2.0, times=[0.0, 0.3, 2.0])
    after = v0 * np.array([0.05, 0.95])
    rolls = 5 / 7 * after + 2 / 7 * np.array([v0, 0.0])
    np.testing.assert_allclose(run.velocity[-1, :, 0], rolls, rtol=10 * FORMULA)
    np.testing.assert_allclose(run.spin[-1, :, 2], -rolls / radius, rtol=10 * FORMULA)
    assert np.max(np.abs(run.velocity[-1, :, 1:])) < FORMULA


def test_a_run_continues_from_its_end(tmp_path):
    """Spins and sliding go on; the moment at which rolling begins is the same. Files have them."""
    whole = go(on_a_belt([2.0, 0.0]), 1.0)
    second = go(go(on_a_belt([2.0, 0.0]), 0.05).final, 0.95)
    np.testing.assert_allclose(second.velocity[-1], whole.velocity[-1], rtol=FORMULA)
    np.testing.assert_allclose(second.spin[-1], whole.spin[-1], rtol=FORMULA)
    for table, words in ((whole, "spin[0]"), (whole.impacts, "slip_after")):
        table.to_csv(tmp_path / "table.csv")
        assert words in (tmp_path / "table.csv").read_text().splitlines()[0]


def test_what_is_refused():
    ball, wall = jc.Sphere(0.1, 1.0, [0.0, 0.5], spin=1.0), jc.Plane([0.0, 0.0], [0.0, 1.0])
    line, rigid = [jc.Sphere(0.1, 1.0, [1.0])], LAWS["rigid"]
    for words, make in (
        (r"friction.*Sphere.*`spin`.*Coulomb\(mu=0", lambda: jc.Scene([ball, wall], jc.Hertz())),
        (r"friction.*one dimension", lambda: jc.Scene(line, jc.Hertz(), friction=rigid)),
        (r"spin.*one number", lambda: jc.Sphere(0.1, 1.0, [0.0, 0.0], spin=[1.0, 2.0])),
        (r"spin.*fixed=True", lambda: jc.Sphere(0.1, None, [0.0, 0.0], fixed=True, spin=1.0)),
    ):
        with pytest.raises(ValueError, match=words):
            make()


def test_sliding_and_belts_close_the_energy_balance():
    """Energy = first energy + work of walls - losses of impacts - loss by sliding."""
    how = {"e": 0.4, "mu": 0.05, "drift": [1.4, 0.1], "normal": [0.1, 1.0]}
    run = go(on_a_belt([4.0, 0.0], 30.0, height=0.11, **how), 3.0)
    assert run.impacts.solved_by[-1] == jc.SolvedBy.SERIES and run.sliding_loss > 0.1
    assert missing(run) < ENERGY * run.energy[-1]


def test_laws_with_a_spring_take_their_stiffness_from_the_materials():
    """Test 4 of Chung & Ooi (2011), doi 10.1007/s10035-011-0277-0, at 10 degrees: digits of
    independent solves of the two models, as printed.
    """
    alumina = jc.Material(youngs_modulus=380e9, poisson_ratio=0.23, density=4000.0)
    angle, friction = np.radians(10.0), jc.SpringSlider(mu=0.092)
    velocity = [3.9 * np.sin(angle), -3.9 * np.cos(angle)]
    balls = [
        jc.Sphere(0.0025, position=[x, 0.01], velocity=velocity, material=alumina, name=name)
        for x, name in ((0.0, "whole"), (1.0, "spring"))
    ]
    laws = {("whole", "wall"): jc.MawBarberFawcett(mu=0.092), "default": friction}
    wall = jc.Plane([0.0, 0.0], [0.0, 1.0], name="wall")
    run = go(jc.Scene([*balls, wall], jc.ExactRestitution(e=0.98), friction=laws), 0.01)
    ratio = run.velocity[-1, :, 0] / velocity[0]
    np.testing.assert_allclose(ratio, [0.638147, 0.71353918], rtol=1e-6)
    np.testing.assert_allclose(run.spin[-1], [-245.0567, -193.99926], rtol=1e-6)


@pytest.mark.parametrize("instantaneous", [True, False], ids=["instantaneous", "soft"])
def test_an_impact_outside_of_the_table_of_its_law_ends_the_run(instantaneous):
    ball, wall = jc.Sphere(0.1, 0.5, [0.0, 0.2], [0.3, -2.0]), jc.Plane([0.0, 0.0], [0.0, 1.0])
    friction = jc.MawBarberFawcett(0.2, 0.3)  # χ = 0.525
    scene = jc.Scene([ball, wall], jc.HuGuo(e=0.7), friction=friction, stiffness=1e6)
    with pytest.raises(jc.NumericalError, match=r"`MawBarberFawcett` for χ.*`SpringSlider`"):
        jc.simulate(scene, 0.1, times=[0.04, 0.1], instantaneous=instantaneous)
    run = jc.simulate(scene, 0.1, times=[0.04, 0.1], instantaneous=instantaneous, throw=False)
    assert run.status == int(jc.Ending.FRICTION_NOT_MODELLED)
    np.testing.assert_allclose(run.reached, 0.05, rtol=FORMULA)
    assert bool(jnp.isfinite(run.velocity[0]).all()) and bool(jnp.isnan(run.velocity[1]).all())

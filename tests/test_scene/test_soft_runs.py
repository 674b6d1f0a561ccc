"""Whole runs with impacts of finite duration, against Newton's equations with restarts.

Published numbers; energy over many impacts; rest and waking; pairs with laws of different kinds.
"""

import functools
import sys
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from benchmarks.scenes import SKIPS
from jaxcontact._scene.engine import pieces
from tests.oracle.scene_oracle import Ball, Spring, Wall, run
from tests.test_scene.support import bodies_of, in_a_line, missing, simulate, spheres

K = 1e6  # in N/m^1.5: a contact of two balls of 1 kg at 1 m/s lasts about 0.01 s
BELOW = Wall([0.0, -0.5], [0.0, 1.0])
FAR = Wall([-9.0, 0.0], [1.0, 0.0])
CORNER = [Wall([0.0, 0.0], [1.0, 0.0]), Wall([0.0, 0.0], [0.0, 1.0])]

RUNS = {
    # Unequal balls, some so close that their impacts overlap.
    "line": (
        [
            Ball([0.0], [1.0], 0.1, 1.0),
            Ball([0.3], [0.0], 0.1, 2.0),
            Ball([0.5001], [0.0], 0.1, 0.5),
            Ball([0.7002], [0.0], 0.1, 3.0),
            Ball([1.2], [-0.5], 0.1, 1.0),
        ],
        [Wall([-9.0], [1.0])],
        None,
        0.5,
        1.0,
    ),
    # Two unequal balls that pass each other, and a wall for the one that flies on.
    "oblique": (
        [Ball([0.0, 0.0], [1.0, 0.0], 0.1, 1.0), Ball([0.5, 0.12], [-0.5, 0.1], 0.1, 2.0)],
        [BELOW, FAR],
        None,
        1.0,
        0.8,
    ),
    "corner": (
        [Ball([0.5, 0.5], [-1.0, -1.0], 0.1, 1.0), Ball([9.0, 9.0], [0.0, 0.0], 0.1, 1.0)],
        CORNER,
        None,
        0.5,
        0.8,
    ),
    # Under its weight; the third contact is permanent.
    "floor": ([Ball([0.15], [0.0], 0.1, 1.0)], [Wall([0.0], [1.0])], [-9.81], 1.5, 0.3),
    # The weight acts from the touch on, so v0 is slightly larger than the speed at touch.
    "bounces": ([Ball([0.6], [0.0], 0.1, 1.0)], [Wall([0.0], [1.0])], [-9.81], 0.9, 1.6),
}


def soft(balls, walls, gravity, alpha, stiffness=K):
    """A scene of five balls and a wall in a line, or of two and two in a plane: what is missing is
    far away, so that all of them share their programs. Without any gravity there would be others.
    """
    axes = len(balls[0].position)
    far = [[100.0 + k] * axes for k in range((5, 2)[axes - 1] - len(balls))]
    balls = [*balls, *(Ball(place, [0.0] * axes, 0.1) for place in far)]
    bodies = bodies_of(balls, [*walls, FAR][:axes])
    gravity = [1e-15] * axes if gravity is None else gravity
    return jc.Scene(bodies, jc.Damped(alpha=alpha), stiffness=stiffness, gravity=gravity)


@functools.cache
def reference(name):
    balls, walls, gravity, alpha, duration = RUNS[name]
    return run(balls, Spring(K, alpha=alpha), duration, walls, gravity)


@pytest.mark.parametrize("name", RUNS)
def test_runs_end_where_newtons_equations_do(name):
    """At other tolerances: `test_random_spheres`."""
    (balls, _, _, _, duration), rtol = RUNS[name], 1e-9
    exact, found = reference(name), jc.simulate(soft(*RUNS[name][:4]), duration, rtol=rtol)
    assert found.status == jc.Ending.COMPLETED
    speed = max(np.abs(b.velocity).max() for b in balls) or 1.0
    velocity, position = (x[-1, : len(balls)] for x in (found.velocity, found.position))
    assert np.abs(velocity - exact.velocity).max() <= 10 * rtol * speed
    assert np.abs(position - exact.position).max() <= 10 * rtol * speed * duration
    hits = found.impacts.to_dict()
    began = np.array([touch.begin for touch in exact.touches])
    np.testing.assert_allclose(np.sort(hits["time"]), np.sort(began), atol=10 * rtol * duration)
    over = np.array([touch.end is not None for touch in exact.touches])
    if len(set(began)) == len(began):
        order = np.argsort(hits["time"])
        lost = np.array([touch.lost for touch in exact.touches])[np.argsort(began)]
        over = over[np.argsort(began)]
        loss = hits["energy_loss"][order]
        np.testing.assert_allclose(loss[over], lost[over], atol=10 * rtol)
        # The reference evaluates its forces five times per step.
        force = np.array([touch.max_force for touch in exact.touches])[np.argsort(began)]
        np.testing.assert_allclose(hits["max_force"][order][over], force[over], rtol=2e-3)
    if np.all(over):
        assert missing(found) <= 100 * rtol * found.energy[0]


GLASS = jc.Material(youngs_modulus=48e9, poisson_ratio=0.20, density=2800.0)
ALUMINIUM = jc.Material(youngs_modulus=70e9, poisson_ratio=0.30, density=2699.0)


def followed(balls, duration):
    """Elastic balls beside a plane at 0, as many in all tests, which share their programs so."""
    far = [
        jc.Sphere(0.01, position=[50.0 + k], velocity=[0.0], material=GLASS)
        for k in range(5 - len(balls))
    ]
    scene = jc.Scene([*balls, *far, jc.Plane([0.0], [1.0])], jc.Damped(alpha=0.0))
    return jc.simulate(scene, duration)


def test_spheres_of_glass_and_of_aluminium():
    """Cases 1 and 2 of Chung & Ooi (2011), doi 10.1007/s10035-011-0277-0, far from each other: two
    equal spheres, by the closed form, and one on a rigid plane.
    """
    balls = [
        jc.Sphere(0.01, position=[9.98], velocity=[10.0], material=GLASS),
        jc.Sphere(0.01, position=[10.02], velocity=[-10.0], material=GLASS),
        jc.Sphere(0.1, position=[0.11], velocity=[-0.2], material=ALUMINIUM),
    ]
    run = followed(balls, 0.1)
    hits = run.impacts.to_dict()
    assert hits["solved_by"].tolist() == [jc.SolvedBy.CLOSED_FORM] * 2
    np.testing.assert_allclose(hits["max_force"], [10696.889, 11369.858], rtol=5e-8)
    np.testing.assert_allclose(hits["duration"], [4.03394557e-5, 7.31656641e-4], rtol=5e-9)
    np.testing.assert_allclose(run.velocity[-1, :3, 0], [-10.0, 10.0, 0.2], rtol=1e-12)


def test_the_hertz_chain():
    """Five equal balls that just touch, and one that is struck: any K and m."""
    places = [1 + 0.02 * k for k in range(5)]
    speeds = [1.0, 0.0, 0.0, 0.0, 0.0]
    balls = [
        jc.Sphere(0.01, position=[x], velocity=[v], material=GLASS)
        for x, v in zip(places, speeds, strict=True)
    ]
    run = followed(balls, 0.01)
    speeds = [-0.0710850, -0.0302738, -0.0144636, 0.1270450, 0.9887774]
    np.testing.assert_allclose(run.velocity[-1, :, 0], speeds, atol=1e-7)
    assert np.all(run.impacts.solved_by == jc.SolvedBy.COUPLED)
    # The lost energy is that of the errors alone.
    np.testing.assert_allclose(run.energy[-1], run.energy[0], rtol=1e-8)


def test_three_damped_balls_in_a_row():
    """They just touch; two independent codes agree, for v0 = the largest closing speed."""
    row = [Ball([float(x)], [v]) for x, v in enumerate([1.0, 0.0, 0.0])]
    run = jc.simulate(soft(row, [Wall([-9.0], [1.0])], None, 0.5), 0.1, rtol=1e-9)
    speeds = [-0.01488824, 0.25259641, 0.76229183]
    np.testing.assert_allclose(run.velocity[-1, :3, 0], speeds, atol=6e-9)


LINE = [Ball([float(k)], [1.0 if k == 0 else 0.0]) for k in range(3)]
"""Three just touching balls in one dimension, the first one at speed one."""


def test_three_balls_whose_force_ends_before_they_part():
    """The last one is touched later. A law that is clamped: others are in `RUNS`."""
    law, row = jc.AntypovElliott(e=0.5, tension=False), [*LINE[:2], Ball([2.001], [0.0])]
    c = 2 * float(law.damping_ratio()) * np.sqrt(2.5 / 2) * np.sqrt(1e4 * 0.5)
    exact = run(row, Spring(1e4, c=c), until_apart=True)
    found = simulate(jc.Scene(bodies_of(row), law, stiffness=1e4), 1.0)
    np.testing.assert_allclose(found.velocity[-1], exact.velocity, atol=1e-8)
    hits = found.impacts.to_dict()
    over = [touch.end - touch.begin for touch in exact.touches]
    assert np.all(hits["duration"] < over)


@pytest.mark.slow(reason="several soft scenes, each a program")
def test_the_least_speed_at_touch_decides_the_answer():
    """As in SCENES: the last of three just touching balls, for floors of the latched speed."""
    for floor, last in ((0.01, 0.57), (0.1, 0.63), (1.0, 0.81)):
        scene = jc.Scene(bodies_of(LINE), jc.Damped(alpha=0.5), stiffness=1e4)
        speeds = jc.simulate(scene, 1.0, v0=floor, rtol=1e-6).velocity[-1]
        exact = run(LINE, Spring(1e4, alpha=0.5), v0=floor, until_apart=True)
        np.testing.assert_allclose(speeds, exact.velocity, atol=1e-6)
        assert abs(speeds[2, 0] - last) < 6e-3


def test_no_step_passes_over_a_touch():
    """Beside a ball that swings on a floor, two others graze each other for 30 ms."""
    offset, speed, pull = 0.99, 10.0, [0.0, 0.0, -9.81]
    for wait in np.linspace(0.3, 0.4, 9):
        place = [-speed * wait - np.sqrt(1 - offset**2), offset, 20.0]
        places, speeds = [[9.0, 0.0, 0.5], place, [0.0, 0.0, 20.0]], [None, [speed, 0.0, 0.0], None]
        bodies = [*spheres(0.5, 1.0, places, speeds), jc.Plane([0.0, 0.0, 0.0], [0.0, 0.0, 1.0])]
        found = simulate(jc.Scene(bodies, jc.Hertz(), stiffness=1e4, gravity=pull), 0.6)
        hits = found.impacts.to_dict()
        met = (hits["first"] == 1) & (hits["second"] == 2)
        np.testing.assert_allclose(hits["time"][met], wait, rtol=1e-5)
        assert hits["max_force"][met] > 1e4 * 1e-3**1.5
        assert hits["solved_by"][met] == jc.SolvedBy.COUPLED


RECORDED = 4e-5
"""What Exudyn's steps leave of its rebounds, by the difference to the closed form: 3.4e-5."""


def test_the_rebounds_that_exudyn_recorded():
    """Its contact of Hunt and Crossley, asked for these e at 10 m/s, in steps; and the closed form,
    to all digits that are given.
    """
    asked = [0.9, 0.8, 0.5, 0.3, 0.1]
    recorded = [0.9090299, 0.8329035, 0.6629838, 0.5813176, 0.5158574]
    exact = [0.9090157, 0.8328698, 0.6629622, 0.5812880, 0.5158326]
    ball, wall = Ball([0.02], [-10.0], 0.01, 0.03), Wall([0.0], [1.0])
    factors = [float(jc.HuntCrossley(e=e).damping_factor()) for e in asked]
    runs = [jc.simulate(soft([ball], [wall], None, alpha, 1e8), 0.005) for alpha in factors]
    rebounds = np.array([float(run.velocity[-1, 0, 0]) / 10 for run in runs])
    np.testing.assert_allclose(rebounds, recorded, rtol=0, atol=RECORDED)
    np.testing.assert_allclose(rebounds, exact, rtol=0, atol=6e-8)
    np.testing.assert_allclose([run.impacts.restitution[0] for run in runs], rebounds, rtol=1e-12)


BALANCE, GAS = 1e-9, 1e-8
"""Energy at the end against the start less what was lost, relative: measured 6e-12 (8 impacts with
rest) and 6e-10 (1237 impacts of a gas)."""

GOES_ON = 1e-9  # of a run in two parts, in m, m/s, J and s: measured 2e-10
STILL = 1e-8  # in m/s, of what came to rest and lies near others: measured 2e-10
STEP = 1e-2
"""Of a duration that ends before the contact opens, with the force: it is known to a step of the
coupled solve; measured 6e-4."""


def _on_a_floor(*balls):
    return soft(balls, CORNER[1:], [0.0, -9.81], float(jc.HuGuo(e=0.3).damping_factor()))


def _hit_at_rest(beside=0.25, height=2.5):
    """A ball that comes to rest, and another one that falls on it, or `beside` it."""
    balls = ([0.0, 0.1005], [0.1, 0.0]), ([beside, height], [0.0, 0.0])
    return _on_a_floor(*(Ball(*ball, 0.1) for ball in balls))


@pytest.fixture(scope="module")
def whole():
    return jc.simulate(_hit_at_rest(), 1.5, times=np.linspace(0, 1.5, 16))


def test_a_ball_rests_slides_and_wakes(whole):
    """It sinks in by its static indentation, is hit by another one, and rests again."""
    run = whole
    assert run.status == jc.Ending.COMPLETED
    hits = run.impacts.to_dict()
    assert np.all(hits["solved_by"] == jc.SolvedBy.COUPLED)
    assert hits["duration"][0] == np.inf and hits["restitution"][0] == 0
    sunk = (9.81 / 1e6) ** (2 / 3)
    np.testing.assert_allclose(run.position[1:7, 0, 1], 0.1 - sunk, atol=1e-6 * sunk)
    np.testing.assert_allclose(run.position[1:7, 0, 0], 0.01 * np.arange(1, 7), rtol=1e-12)
    # The output at 0.7 is inside the contacts of three bodies.
    assert hits["time"][1] < 0.7 < hits["time"][3] + hits["duration"][3]
    assert np.all(np.diff(run.energy) < 1e-8)
    assert missing(run) < BALANCE * run.energy[0]


@pytest.mark.parametrize(("until", "first"), [(0.6, "rest"), (0.7, "contact")])
def test_a_run_goes_on_from_rest_and_from_contact(until, first, whole):
    times = np.linspace(0, 1.5, 16)
    # The same number in both cases, so that they share their programs.
    later = times[-9:]
    ends = jc.simulate(_hit_at_rest(), until).final
    run = jc.simulate(ends, 1.5 - until, times=np.maximum(later - until, 0))
    assert run.status == jc.Ending.COMPLETED
    for name in ("position", "velocity", "energy"):
        expected = getattr(whole, name)[-len(later) :]
        np.testing.assert_allclose(getattr(run, name), expected, rtol=0, atol=GOES_ON)
    hits, all_of_them = run.impacts.to_dict(), whole.impacts.to_dict()
    # Contacts at the start touched before it; bodies that rest there have no impact.
    assert (hits["time"][0] < 0) == (first == "contact")
    over = all_of_them["time"] + all_of_them["duration"] <= until
    over[0] = True
    assert len(hits["time"]) == np.sum(~over)
    np.testing.assert_allclose(hits["time"], all_of_them["time"][~over] - until, atol=GOES_ON)
    np.testing.assert_allclose(hits["duration"], all_of_them["duration"][~over], rtol=STEP)
    lost = np.sum(hits["energy_loss"])
    start = whole.energy[np.argmin(np.abs(times - until))]
    assert abs(start - run.energy[-1] - lost) < BALANCE * start


def test_what_a_run_cannot_go_on_from():
    ends = jc.simulate(_hit_at_rest(), 0.7).final
    with pytest.raises(ValueError, match=r"`instantaneous` must be False .* but is True"):
        jc.simulate(ends, 1.0, instantaneous=True)
    with pytest.raises(ValueError, match=r"`max_cluster` must be that of the run .*, 2, but is 1"):
        jc.simulate(eqx.tree_at(lambda s: s.bodies, ends, ends.bodies[1:]), 1.0)


def test_a_ball_comes_to_rest_on_another():
    """What leans on others stays in one solve until all stand still; then time passes at once."""
    balls = [Ball([0.0, x], [0.0, 0.0], 0.1, m) for x, m in ((0.1001, 2.0), (0.3101, 1.0))]
    whole = jc.simulate(_on_a_floor(*balls), 1.5, times=np.linspace(0, 1.5, 16))
    assert whole.status == jc.Ending.COMPLETED
    # Halfway, against Newton's equations.
    spring = Spring(1e6, alpha=float(jc.HuGuo(e=0.3).damping_factor()))
    lines = [Ball(b.position[1:], [0.0], 0.1, b.mass) for b in balls]
    exact = run(lines, spring, 0.1, [Wall([0.0], [1.0])], [-9.81])
    np.testing.assert_allclose(whole.position[1, :, 1], exact.position[:, 0], atol=1e-9)
    np.testing.assert_allclose(whole.velocity[1, :, 1], exact.velocity[:, 0], atol=1e-7)
    # At the end, by statics.
    low = 0.1 - (3 * 9.81 / 1e6) ** (2 / 3)
    high = low + 0.2 - (9.81 / 1e6) ** (2 / 3)
    np.testing.assert_allclose(whole.position[-1, :, 1], [low, high], atol=1e-10)
    assert np.all(whole.velocity[-1] == 0)
    assert missing(whole) < BALANCE * whole.energy[0]


def test_what_rests_while_another_bounces_is_listed_once():
    times = np.linspace(0, 1.5, 16)
    run = jc.simulate(_hit_at_rest(beside=0.5, height=0.5), 1.5, times=times)
    hits = run.impacts.to_dict()
    pressed, bounces = hits["first"] == 0, hits["first"] == 1
    assert np.sum(pressed) == 1 and np.sum(bounces) == 3
    assert hits["restitution"][0] == 0 and hits["duration"][0] == np.inf
    # It was at rest in between, and the table lists all of the loss.
    np.testing.assert_allclose(run.velocity[2:, 0], [[0.1, 0.0]] * 14, atol=STILL)
    assert missing(run) < BALANCE * run.energy[0]


@pytest.mark.slow(reason="a long soft run")
def test_a_gas_of_soft_elastic_balls_keeps_its_energy():
    places, rng = [[0.2, 0.2], [0.7, 0.3], [0.3, 0.7], [0.75, 0.75]], np.random.default_rng(2)
    balls = spheres(0.05, 1.0 + 0.2 * np.arange(4), places, rng.normal(size=(4, 2)))
    scene = jc.Scene([*balls, jc.Box([0.0, 0.0], [1.0, 1.0])], jc.Hertz(), stiffness=1e9)
    run = jc.simulate(scene, 100.0)
    assert len(run.impacts) > 1000
    ways = {jc.SolvedBy.CLOSED_FORM, jc.SolvedBy.RADIAL, jc.SolvedBy.COUPLED}
    assert set(run.impacts.solved_by.tolist()) == ways
    assert abs(run.energy[-1] / run.energy[0] - 1) < GAS


def test_crowds_are_refused_or_given_room(monkeypatch):
    """Nine balls, three of which touch at once, where a coupled solve has room for two. Another
    impact was before, in a log with fewer slots.
    """
    piece, states = pieces._quickly, []

    def noted(*inputs):
        ended = piece(*inputs)
        states.append([jax.tree.map(jax.typeof, state) for state in (inputs[2], ended[0])])
        return ended

    monkeypatch.setattr(pieces, "_PIECE", 1)
    monkeypatch.setattr(pieces, "_DIRECT", 0)
    monkeypatch.setattr(pieces, "_quickly", noted)
    places, speeds = [-0.5, 0.0, 0.2, *map(float, range(2, 8))], [0.0] * 9
    speeds[0], speeds[7] = 1.0, 9.0
    scene = jc.Scene(in_a_line(0.1, 1.0, places, speeds), jc.Hertz(), stiffness=1e6)
    run = jc.simulate(scene, 1.0, times=[0.1, 1.0], max_cluster=2, throw=False)
    assert run.status == jc.Ending.CROWDED
    assert np.all(np.isfinite(run.position[0])) and np.all(np.isnan(run.position[1]))
    # From Python the size grows, unless an explicit one was given.
    monkeypatch.setattr(sys.modules["jaxcontact._scene.simulate"], "MOST", 2)
    run = jc.simulate(scene, 1.0, times=[0.1, 1.0])
    assert run.status == jc.Ending.COMPLETED
    # Elastic balls in a row.
    expected = [-0.0709524, 0.0764030, 0.9945493]
    np.testing.assert_allclose(run.velocity[1, :3, 0], expected, atol=1e-7)
    hits = run.impacts.to_dict()
    assert hits["first"].tolist() == [7, 0, 1] or hits["first"].tolist() == [7, 1, 0]
    np.testing.assert_allclose(hits["time"], [0.8 / 9, 0.3, 0.3], atol=1e-12)
    np.testing.assert_allclose(hits["restitution"][0], 1, rtol=1e-12)
    # The next piece has the program of the first.
    assert len(states) > 6 and all(before == after for before, after in states)


ALPHA, A, C = 0.6, 4e-4, 2e5
RTOL = 1e-7


@dataclass(frozen=True)
class Damped(Spring):
    """K d^n + K n A d^(n-1) d' + C d^n d', with tension."""

    A: float = 0.0
    C: float = 0.0

    def force(self, depth: float, rate: float, speed: float) -> float:
        depth, n, K = max(depth, 0.0), self.exponent, self.stiffness
        return (K + self.C * rate) * depth**n + K * n * self.A * depth ** (n - 1) * rate


SPRINGS = {
    ("a", "b"): (jc.Hertz(), Spring(K)),
    ("b", "c"): (jc.KuwabaraKono(A=A), Damped(K, A=A)),
    ("a", "floor"): (jc.ConstantDamping(c=C), Damped(K, C=C)),
    # The same kind with other numbers.
    ("b", "floor"): (jc.ConstantDamping(c=C / 2), Damped(K, C=C / 2)),
    "default": (jc.Damped(alpha=ALPHA), Spring(K, alpha=ALPHA)),
}

NAMES = "a", "b", "c", "floor"

STARTS = {
    # All impacts are isolated; that of a and b is oblique.
    "apart": ([[0.0, 0.6], [0.5, 0.62], [1.3, 0.6]], [[1.0, -0.2], [0.0, -0.3], [-0.8, -0.1]], 1.2),
    # The three meet in a row, on the floor.
    "together": (
        [[0.0, 0.1003], [0.2005, 0.1001], [0.4008, 0.102]],
        [[1.0, -0.3], [0.0, -0.3], [0.0, -0.5]],
        0.06,
    ),
}


def simulated(place, speed, duration):
    balls = spheres(0.1, [1.0, 2.0, 3.0], place, speed, names=NAMES[:3])
    floor = jc.Plane([0.0, 0.0], [0.0, 1.0], name="floor")
    laws = {pair: law for pair, (law, _) in SPRINGS.items()}
    return jc.simulate(jc.Scene([*balls, floor], laws, stiffness=K), duration, rtol=RTOL)


@pytest.mark.slow("apart", reason="a soft scene with a table of laws")
@pytest.mark.parametrize("name", STARTS)
def test_runs_with_a_table_of_laws_end_where_newtons_equations_do(name):
    place, speed, duration = STARTS[name]
    balls = [Ball(x, v, 0.1, 1.0 + k) for k, (x, v) in enumerate(zip(place, speed, strict=True))]

    def spring(i, j):
        pair = NAMES[i], NAMES[j]
        return SPRINGS.get(pair, SPRINGS["default"])[1]

    exact = run(balls, spring, duration, [Wall([0.0, 0.0], [0.0, 1.0])])
    found = simulated(place, speed, duration)
    assert found.status == jc.Ending.COMPLETED
    coupled = name == "together"
    assert np.any(found.impacts.solved_by == jc.SolvedBy.COUPLED) == coupled
    assert len(found.impacts) == (5 if coupled else 3)
    np.testing.assert_allclose(found.velocity[-1], exact.velocity, atol=10 * RTOL)
    np.testing.assert_allclose(found.position[-1], exact.position, atol=10 * RTOL * duration)
    lost = sum(touch.lost for touch in exact.touches)
    np.testing.assert_allclose(np.sum(found.impacts.energy_loss), lost, atol=10 * RTOL)


SAME, SOLVED = 1e-11, 1e-9
"""Of velocities of about 1 m/s; where a solve takes the place of a closed form, its `rtol`:
measured 6e-15 and 3e-11."""


@pytest.mark.slow(
    "Hertz by its closed form, or by its force", "Hertz, or a damping of 0",
    "four balls at rest, or hopping", "one shared law, or a table of equal ones",
    reason="two soft scenes",
)  # fmt: skip
@pytest.mark.parametrize("name", SKIPS)
def test_the_result_is_the_same(name):
    lean, whole = (np.asarray(jax.jit(way)(jnp.asarray(1.0))) for way in SKIPS[name][:2])
    assert np.all(np.isfinite(lean)) and np.max(np.abs(lean)) > 0.1
    np.testing.assert_allclose(whole, lean, rtol=0, atol=SOLVED if SKIPS[name].soft else SAME)

"""Instantaneous impacts: known answers, ties, rest, and energy over many impacts."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_scene.support import go, in_a_line, missing, spheres

EXACT = 1e-12
"""Times, heights and speeds of the bouncing ball, relative to the drop: measured 3e-14."""

ENERGY = 1e-12
"""Energy of an elastic gas over 1e4 impacts, relative: measured 1e-13."""

COUNTED = 0.024
"""The mean free time, relative: sixteen seeds scatter by 0.7 % and are 0.3 % long, for 64 spheres
are few. A gas is chaotic, so that another processor's rounding is another seed."""

FLOOR = jc.Plane([0.0, 0.0], [0.0, 1.0], name="floor")


def dropped(middle, duration):
    ball = jc.Sphere(0.01, 0.03, [0.0, 1.01], name="ball")
    scene = jc.Scene([ball, FLOOR], jc.ExactRestitution(e=0.9), gravity=[0.0, -9.81])
    return go(scene, duration, times=[0.0, middle, duration])


def test_a_bouncing_ball_after_44_impacts():
    run = dropped(8.0, 8.5)
    assert len(run.impacts) == 44
    height = run.position[-1, 0, 1] - 0.01
    assert abs(height - 5.565551008992671e-6) < EXACT
    assert abs(run.velocity[-1, 0, 1] + 4.166519580981356e-2) < EXACT * np.sqrt(2 * 9.81)
    assert run.status == jc.Ending.COMPLETED


def test_the_bounces_come_to_an_end_and_the_ball_rests():
    run = dropped(8.7, 9.0)
    last = run.impacts.to_dict()
    assert last["solved_by"][-1] == jc.SolvedBy.SERIES
    assert np.sum(last["solved_by"] == jc.SolvedBy.SERIES) == 1
    assert abs(last["time"][-1] + last["duration"][-1] - 8.578949178728887) < EXACT * 9
    np.testing.assert_allclose(run.position[1:, 0, 1], 0.01, rtol=1e-14)
    assert np.max(np.abs(run.velocity[1:])) < 1e-15
    assert missing(run) < ENERGY * run.energy[0]


def test_a_resting_ball_slides_and_can_be_hit():
    """Only the normal motion rests; what falls on a ball at rest is met by a quartic."""
    balls = spheres(0.1, 1.0, [[0.0, 0.1], [0.05, 2.0]], [[0.3, 0.0]] * 2)
    run = go(jc.Scene([*balls, FLOOR], jc.ExactRestitution(e=0.5), gravity=[0.0, -10.0]), 0.7)
    hits = run.impacts.to_dict()
    assert (hits["first"][0], hits["second"][0], hits["solved_by"][0]) == (0, 2, jc.SolvedBy.SERIES)
    # It falls 2 - 0.1 - sqrt(0.2² - 0.05²).
    time = np.sqrt(2 * (1.9 - np.sqrt(0.04 - 0.0025)) / 10)
    np.testing.assert_allclose(hits["time"][1], time, rtol=1e-13)
    assert {hits["first"][1], hits["second"][1]} == {0, 1}
    # The lower one is pushed into the floor, which returns the push immediately.
    assert (hits["first"][2], hits["second"][2]) == (0, 2) and hits["tied"][2]
    before = run.at(time / 2)
    np.testing.assert_allclose(before.position[0, 0], [0.15 * time, 0.1], rtol=1e-13)


def test_a_ball_in_a_corner_meets_both_walls():
    ball = jc.Sphere(0.1, 1.0, [0.5, 0.5], [-1.0, -1.0])
    run = go(jc.Scene([ball, jc.Box([0.0, 0.0], [2.0, 2.0])], jc.ExactRestitution(e=0.5)), 1.0)
    assert sorted(run.impacts.face.tolist()) == [0, 2]
    assert bool(np.all(run.impacts.tied)) and run.margin.time == 0
    np.testing.assert_allclose(run.velocity[-1, 0], [0.5, 0.5], rtol=1e-15)
    np.testing.assert_allclose(run.position[-1, 0], [0.4, 0.4], rtol=1e-14)


def test_a_box_may_have_open_sides_in_a_trace():
    """Given there, and as an argument."""

    def end(box, speed):
        scene = jc.Scene([jc.Sphere(0.1, 1.0, [0.5, 0.5], speed), box], jc.ExactRestitution(e=0.5))
        return go(scene, 1.0, max_impacts=4).position[-1, 0]

    sides, speed = ([-np.inf, 0.0], [np.inf, 1.0]), np.array([3.0, 1.0])
    for found in (
        jax.jit(lambda speed: end(jc.Box(*sides), speed))(speed),
        jax.jit(end)(jc.Box(*sides), speed),
    ):
        np.testing.assert_allclose(found, [3.5, 0.6], rtol=1e-14)


def line(place, speed, e=1.0):
    """Five equal balls on an axis, the last ones far away, so that all share their programs."""
    far = [90.0 + k for k in range(5 - len(place))]
    balls = in_a_line(0.1, 1.0, [*place, *far], [*speed, *[0.0] * len(far)])
    return jc.Scene(balls, jc.ExactRestitution(e=e))


def test_a_cradle():
    """Balls that touch, and one that comes from the left."""
    run = go(line([-0.5, 0.0, 0.2, 0.4, 0.6], [1.0, 0.0, 0.0, 0.0, 0.0]), 1.0)
    np.testing.assert_array_equal(run.velocity[-1, :, 0], [0.0, 0.0, 0.0, 0.0, 1.0])
    assert run.impacts.tied.tolist() == [False, True, True, True]


def test_simultaneous_impacts_go_by_closing_speed():
    """A ball between two that come with different speeds: the faster one is first."""
    run = go(line([-1.2, 0.0, 2.2], [1.0, 0.0, -2.0]), 1.5)
    rows = run.impacts.to_dict()
    assert {rows["first"][0], rows["second"][0]} == {1, 2}
    assert rows["closing_speed"].tolist() == [2.0, 3.0, 1.0] and all(rows["tied"])
    np.testing.assert_allclose(run.velocity[-1, :3, 0], [-2.0, 0.0, 1.0], atol=1e-15)


def test_an_output_at_the_moment_of_an_impact():
    """It never cuts a step: the impact happens, and the values are those after it."""
    scene = line([0.0, 1.2], [1.0, 0.0])
    run = go(scene, 2.0, times=[0.5, 1.0, 1.5])
    # The impact is at 1, up to rounding.
    np.testing.assert_allclose(run.impacts.time, [1.0], rtol=1e-15)
    at = run.at(run.impacts.time)
    np.testing.assert_array_equal(at.velocity[0, :2, 0], [0.0, 1.0])
    np.testing.assert_allclose(run.position[:, :2, 0], [[0.5, 1.2], [1.0, 1.2], [1.0, 1.7]])
    ends_there = go(scene, float(run.impacts.time[0]))
    assert len(ends_there.impacts) == 1
    np.testing.assert_array_equal(ends_there.velocity[-1, :2, 0], [0.0, 1.0])
    goes_on = go(ends_there.final, 1.0)
    assert len(goes_on.impacts) == 0
    np.testing.assert_allclose(goes_on.position[-1, :2, 0], [1.0, 2.2])


def gas(count, axes, periodic, size=1.0, radius=0.08):
    rng = np.random.default_rng(1)
    places = np.array(list(np.ndindex(*([3] * axes))))[:count]
    starts = [
        ((place + 0.5) * size / 3 + rng.uniform(-0.03, 0.03, axes), rng.normal(size=axes))
        for place in places
    ]
    bodies = spheres(radius, 1.0 + 0.1 * np.arange(count), *zip(*starts, strict=True))
    box = [] if periodic else [jc.Box([0.0] * axes, [size] * axes)]
    return jc.Scene([*bodies, *box], jc.Hertz(), periodic=[size] * axes if periodic else None)


@pytest.mark.slow("False", reason="the long run once more without cells")
@pytest.mark.parametrize("periodic", [False, True])
def test_an_elastic_gas_keeps_its_energy_and_never_overlaps(periodic):
    run = go(gas(8, 2, periodic), 600.0, times=np.linspace(0, 600, 401))
    assert len(run.impacts) > 10_000
    assert np.max(np.abs(run.energy / run.energy[0] - 1)) < ENERGY
    apart = np.asarray(run.position)[:, :, None] - np.asarray(run.position)[:, None]
    apart -= np.round(apart) * periodic
    distance = np.sqrt(np.sum(apart**2, axis=-1)) + np.eye(8)
    assert np.min(distance) > 0.16 * (1 - 1e-12)
    assert np.all(np.diff(run.impacts.time) >= 0)
    if periodic:
        momentum = np.einsum("n,tnd->td", 1 + 0.1 * np.arange(8), run.velocity)
        np.testing.assert_allclose(momentum, momentum[:1] + 0 * momentum, atol=1e-12)
    else:
        assert np.min(run.position) > 0.08 * (1 - 1e-12)


@pytest.mark.slow(reason="thousands of impacts")
def test_a_gas_of_hard_spheres_has_its_mean_free_time():
    """ρσ³ = 0.5 in three dimensions: 0.13031 (Lue 2005) at unit temperature; 64 spheres here."""
    rng = np.random.default_rng(5)
    count, sigma = 64, 1.0
    size = (count / 0.5) ** (1 / 3)
    places = (np.array(list(np.ndindex(4, 4, 4))) + 0.5) * size / 4
    speeds = rng.normal(size=(count, 3))
    speeds -= speeds.mean(axis=0)
    speeds /= np.sqrt(np.mean(speeds**2))
    bodies = spheres(sigma / 2, 1.0, places, speeds)
    scene = jc.Scene(bodies, jc.Hertz(), periodic=[size] * 3)
    run = go(scene, 65.0)
    counted = int(np.sum(np.asarray(run.impacts.time) > 5.0))
    assert counted > 10_000
    # Without total momentum: the temperature of 3 (N-1) degrees of freedom.
    free = 60.0 / (2 * counted / count) * np.sqrt(count / (count - 1))
    np.testing.assert_allclose(free, 0.13031, rtol=COUNTED)


def test_two_orders_of_the_same_scene_agree():
    """The order of the bodies is no physics: the first twenty impacts agree to 1e-10."""
    scene = gas(6, 2, False)
    turned = jc.Scene([*scene.spheres[::-1], scene.bodies[-1]], jc.Hertz())
    one, other = go(scene, 3.0), go(turned, 3.0)
    assert min(len(one.impacts), len(other.impacts)) > 20
    np.testing.assert_allclose(one.impacts.time[:20], other.impacts.time[:20], rtol=1e-10)
    time = one.impacts.time[19]
    np.testing.assert_allclose(
        one.at(time).position[0], other.at(time).position[0, ::-1], atol=1e-10
    )


@pytest.mark.parametrize("unit", [1.0, 1e-12])
def test_laws_by_pair_in_either_order(unit):
    """At 1 m/s, and in a unit of time 1e12 times as short: no speed is too small."""
    balls = in_a_line(0.1, 1.0, [0.0, 1.0, 2.0], [unit, 0.0, 0.0], ["a", "b", "c"])
    # The units of e(v) cancel in the ratio of length and time.
    laws = {("b", "a"): jc.ExactRestitution(e=0.5), "default": jc.MarhefkaOrin(a=0.2 / unit)}
    run = go(jc.Scene(balls, laws, stiffness=1e6), 4.0 / unit)
    e = run.impacts.restitution
    np.testing.assert_allclose(e[0], 0.5, rtol=1e-13)
    speed = run.impacts.closing_speed[1] / unit
    wanted = jc.restitution(jc.MarhefkaOrin(a=0.2), jc.Contact(0.5, 1e6), speed)
    np.testing.assert_allclose(e[1], wanted, rtol=1e-13)
    assert speed == pytest.approx(0.75)


def test_hertz_stiffness_from_materials_enters_a_law_that_needs_it():
    steel, law = jc.Material(2e11, 0.3, 7800.0), jc.ConstantDamping(c=1e9)
    ball = jc.Sphere(0.01, None, [0.5], [-1.0], steel)
    larger = jc.Sphere(0.03, None, [0.0], None, steel)
    for other, contact in (
        (jc.Plane([0.0], [1.0]), jc.Contact.sphere_plane(0.01, steel)),
        (larger, jc.Contact.sphere_sphere(0.01, 0.03, steel, steel)),
    ):
        run = go(jc.Scene([ball, other], law), 1.0)
        wanted = jc.restitution(law, contact, 1.0)
        np.testing.assert_allclose(run.impacts.restitution, [wanted], rtol=1e-13)


def test_what_accumulates_elsewhere_stops_and_is_flagged():
    """Three balls, the outer ones heavy and closing in: an inelastic collapse."""
    scene = line([-1.0, 0.0, 1.0], [1.0, 0.0, -1.3], e=0.05)
    run = go(scene, 3.0, times=[0.1, 3.0], throw=False)
    assert run.status == jc.Ending.ACCUMULATED
    assert np.all(np.isfinite(run.position[0])) and np.all(np.isnan(run.position[1]))
    assert 0 < run.reached < 3


def test_tables_read_well():
    run = dropped(0.5, 1.0)
    assert "1 impact" in str(run.impacts) and "ball - floor" in str(run.impacts)
    assert "completed" in str(run) and "44.2945" not in str(run)
    assert set(run.impacts.to_dict()) >= {"time", "first", "second", "face", "restitution"}
    assert "Scene(1 Sphere, 1 Plane; 2D; ExactRestitution)" in str(run.scene)
    frame = pytest.importorskip("pandas") and run.impacts.to_dataframe()
    assert len(frame) == 1
    run = go(gas(6, 2, False), 20.0)
    assert "..." in str(run.impacts) and "face" in str(run.impacts)


def test_single_precision():
    def to_single(x):
        return x.astype(jnp.float32) if x.dtype == jnp.float64 else x

    double = go(gas(6, 2, False), 1.0)
    run = go(jax.tree.map(to_single, gas(6, 2, False)), 1.0)
    assert run.position.dtype == jnp.float32
    assert len(run.impacts) == len(double.impacts)
    np.testing.assert_allclose(run.impacts.time[:3], double.impacts.time[:3], rtol=1e-5)

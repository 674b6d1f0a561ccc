"""Plots of runs: world lines, paths, energy and animations match the run."""

import io

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.patches import Circle
from PIL import Image

import jaxcontact as jc
from jaxcontact.plot._drawing.path import line_of, path_of
from tests.test_impact.test_warm_calls import work_of

LAW, ELASTIC = jc.ExactRestitution(e=0.8), jc.ExactRestitution(e=1.0)
EXACT = 1e-12  # places that are computed twice, in m and J: measured 2e-16


def hit(bodies, duration, law=LAW, **how):
    """Return a run of instantaneous impacts."""
    return jc.simulate(jc.Scene(bodies, law, **how), duration, instantaneous=True)


def solids(picture):
    return [patch for patch in picture.patches if not isinstance(patch, Circle)]


@pytest.fixture(scope="module")
def box():
    """Two balls in a box under gravity, with six impacts: on walls and on each other."""
    balls = [
        jc.Sphere(0.1, 1.0, [0.5, 0.5], [1.0, 0.3], name="large"),
        jc.Sphere(0.07, 1.0, [0.5, 0.9], [-1.0, 0.3], name="small"),
    ]
    walls = jc.Box([0.0, 0.0], [1.0, 1.2])
    return hit([walls, *balls], 1.0, gravity=[0.0, -9.81])


@pytest.fixture(scope="module")
def ring():
    """Two intervals on a ring of 2 m."""
    balls = [jc.Sphere(0.1, 1.0, [0.5], [1.0]), jc.Sphere(0.05, 1.0, [0.9], [-1.0])]
    return hit(balls, 5.0, periodic=[2.0])


@pytest.fixture(scope="module")
def space():
    """A ball over a slanted plane in three dimensions, seen from its edge along z."""
    plane = jc.Plane([0.0, 0.0, 0.0], [3.0, 4.0, 0.0])
    pin = jc.Sphere(0.05, None, [0.6, 0.3, 0.1], fixed=True)
    ball = jc.Sphere(0.05, 1.0, [0.0, 0.3, 0.1])
    return hit([ball, pin, plane], 0.6, gravity=[0.0, -9.81, 0.0])


def dots(ax):
    (line,) = (line for line in ax.get_lines() if line.get_marker() == ".")
    return np.array(line.get_data()).T


def circles(ax):
    return [patch for patch in ax.patches if isinstance(patch, Circle)]


def test_paths(box):
    _, ax = pyplot.subplots()
    assert jc.plot.scene(box, ax=ax) is ax
    starts, ends = circles(ax)[0::2], circles(ax)[1::2]
    assert [c.get_radius() for c in ends] == [0.1, 0.07]
    for picture, row in ((starts, 0), (ends, 1)):
        np.testing.assert_allclose([c.center for c in picture], box.position[row], atol=EXACT)
    lines = [line for line in ax.get_lines() if len(line.get_xdata()) > 100]
    time = path_of(box).time
    assert len(time) == 512 and np.all(np.isin(box.impacts.time, time))
    assert np.all(np.diff(time) >= 0)
    for k, line in enumerate(lines):
        at = box.at(time).position[:, k]
        np.testing.assert_allclose(np.array(line.get_data()).T, at, atol=EXACT)
    assert len(lines) == 2
    assert ax.get_aspect() == 1.0
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    assert left < 0 and right > 1 and bottom < 0 and top > 1.2
    assert ax.get_xlabel() == "$x$ / m" and ax.get_ylabel() == "$y$ / m"
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["large", "small"]
    ax.figure.canvas.draw()


def test_dots_are_where_surfaces_meet(box):
    where, impacts = dots(jc.plot.scene(box)), box.impacts.to_dict()
    assert len(where) == len(box.impacts) == 6
    for k, dot in enumerate(where):
        centre = box.at(impacts["time"][k]).position[0]
        row, other = impacts["first"][k] - 1, impacts["second"][k]
        np.testing.assert_allclose(np.hypot(*(dot - centre[row])), (0.1, 0.07)[row], atol=EXACT)
        if other == 0:
            face = impacts["face"][k]
            assert abs(dot[face // 2] - ((0.0, 0.0), (1.0, 1.2))[face % 2][face // 2]) < EXACT
        else:
            np.testing.assert_allclose(np.hypot(*(dot - centre[other - 1])), 0.07, atol=EXACT)


def test_world_lines_on_a_ring(ring):
    ax = jc.plot.scene(ring)
    assert ax.get_xlabel() == "time / s" and ax.get_ylabel() == "$x$ / m"
    assert ax.get_xlim() == (0, 5) and ax.get_ylim() == (0, 2)
    # Each band is drawn with its two images.
    assert len(ax.collections) == 6
    where = dots(ax)
    np.testing.assert_allclose(where[:, 0], ring.impacts.time, atol=EXACT)
    for time, place in where:
        centres = np.asarray(ring.at(time).position[0, :, 0])
        apart = (place - centres + 1) % 2 - 1
        np.testing.assert_allclose(np.abs(apart), [0.1, 0.05], atol=EXACT)
    assert ax.get_legend() is None
    ax.figure.canvas.draw()
    with pytest.raises(ValueError, match=r"`axes` must be None .* one dimension, but is \(0, 1\)"):
        jc.plot.animate(ring, axes=(0, 1))


def test_a_line_leaves_and_enters_the_cell_without_a_gap(ring):
    path = path_of(ring)
    time, line = line_of(ring, path, 0)
    gaps = np.flatnonzero(np.isnan(line[:, 0]))
    assert len(gaps) == 4
    for k in gaps:
        # The last point before it lies outside, as does the first one after it.
        assert not 0 <= line[k - 1, 0] <= 2 and not 0 <= line[k + 1, 0] <= 2
    inside = ~np.isnan(line[:, 0]) & (line[:, 0] >= 0) & (line[:, 0] <= 2)
    np.testing.assert_array_equal(time[inside], path.time)
    assert np.nanmax(np.abs(np.diff(line[:, 0]))) < 0.05


def test_space_needs_two_axes(space, box):
    for axes in [(0, 0), (0, 2), (0,), (0.0, 1.0)]:
        with pytest.raises(ValueError, match="`axes` must be two different numbers of 0 and 1, or"):
            jc.plot.scene(box, axes=axes)
    with pytest.raises(ValueError, match=r"`axes` must be two different numbers .*\(0, 2\)"):
        jc.plot.scene(space)
    ax = jc.plot.scene(space, axes=(0, 1))
    np.testing.assert_allclose(circles(ax)[1].center, space.position[1, 0, :2], atol=EXACT)
    np.testing.assert_allclose(dots(ax) @ np.array([0.6, 0.8]), 0, atol=EXACT)
    # The solid lies behind the plane.
    (solid,) = solids(ax)
    assert np.all(solid.get_xy() @ np.array([0.6, 0.8]) < EXACT)
    # From above it is seen face-on and omitted.
    above = jc.plot.scene(space, axes=[2, 0])
    assert solids(above) == []
    assert above.get_xlabel() == "$z$ / m" and above.get_ylabel() == "$x$ / m"


def test_energy(box):
    _, ax = pyplot.subplots()
    assert jc.plot.energy(box, ax=ax) is ax
    line, left = ax.get_lines()
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time / s", "energy / J")
    at = np.searchsorted(left.get_xdata(), line.get_xdata(), side="right") - 1
    np.testing.assert_allclose(left.get_ydata()[at], line.get_ydata(), atol=1e2 * EXACT)
    end = box.energy[0] - np.sum(box.impacts.energy_loss)
    np.testing.assert_allclose(left.get_ydata()[-1], end, atol=1e2 * EXACT)


def test_animation(box, tmp_path):
    _, ax = pyplot.subplots()
    animation = jc.plot.animate(box, seconds=0.5, fps=8, ax=ax)
    animation.save(tmp_path / "run.gif", writer="pillow")
    with Image.open(tmp_path / "run.gif") as picture:
        assert picture.n_frames == 4 and picture.info["duration"] == 120
    # The last frame remains.
    np.testing.assert_allclose([c.center for c in circles(ax)], box.position[1], atol=EXACT)
    assert ax.get_title(loc="left") == "$t$ = 1.00 s"


def test_animations_show_in_notebooks_once(ring):
    animation = jc.plot.animate(ring, seconds=0.4, fps=5)
    assert len(pyplot.get_fignums()) == 1
    page = animation._repr_html_()
    assert "<img" in page and page.count("data:image/png;base64") == 2
    assert pyplot.get_fignums() == []


def test_what_has_no_values_is_refused(box):
    law = jc.ExactRestitution(e=jnp.asarray(-1.0))
    scene = jc.Scene(box.scene.bodies, law, gravity=box.scene.gravity)
    lane = jc.simulate(scene, 1.0, instantaneous=True, throw=False)
    batch = jax.device_put(jax.tree.map(lambda x: np.stack([x, x]), lane))
    with pytest.raises(ValueError, match=r"`run` must be a single run, but is .* \(2,\)"):
        jc.plot.scene(batch)
    for draw in (jc.plot.scene, jc.plot.energy, jc.plot.animate):
        with pytest.raises(ValueError, match=r"values to draw, .* status is 'invalid input'"):
            draw(lane)
    assert not pyplot.get_fignums()


def test_walls_that_move():
    """A still ball over a table that shakes: what is drawn follows the table."""
    table = jc.Plane([0.0], [1.0], motion=jc.Vibration(amplitude=0.02, frequency=50.0, phase=0.5))
    run = hit([jc.Sphere(0.1, 1.0, [0.5]), table], 1.0)
    ax = jc.plot.scene(run)
    level = max(ax.get_lines(), key=lambda line: len(line.get_xdata()))
    time, height = level.get_data()
    np.testing.assert_allclose(height, 0.02 * np.sin(2 * np.pi * 50 * time + 0.5), atol=EXACT)
    # Every period is resolved.
    assert len(time) >= 20 * 50 and np.ptp(height) > 0.0399
    animation = jc.plot.animate(run, seconds=0.8, fps=10)
    solid = solids(animation.figure.axes[0])[0]
    animation.to_jshtml()
    # The last frame remains.
    np.testing.assert_allclose(solid.get_xy()[:, 0].max(), height[-1], atol=EXACT)


def test_what_a_wall_swept_is_light():
    box = jc.Box([0.0, 0.0], [1.0, 1.0], motion=jc.Steady([0.3, 0.0]))
    ball = jc.Sphere(0.1, 1.0, [0.7, 0.5], [0.1, 0.0])
    ax = jc.plot.scene(hit([ball, box], 1.0))
    # The left wall moved from 0 to 0.3: both are solid up to there.
    places = [round(patch.get_xy()[:, 0].max(), 9) for patch in solids(ax)]
    assert [place for place in places if place < 0.5] == [0.3, 0.3]
    # The other one likewise, from 1 to 1.3.
    assert ax.get_xlim()[0] < 0 and ax.get_xlim()[1] > 1.3


def test_shells():
    """A circle is solid around; on a line it is two walls."""
    bodies = [jc.Shell([0.0, 0.5], 1.0), jc.Sphere(0.1, 1.0, [0.0, 0.0], [1.0, 0.0])]
    run = hit(bodies, 2.0, ELASTIC)
    ax = jc.plot.scene(run)
    np.testing.assert_allclose(np.hypot(*(dots(ax) - [0.0, 0.5]).T), 1.0, atol=EXACT)
    (solid,) = solids(ax)
    assert solid.get_path().contains_point([1.02, 1.5])
    assert not solid.get_path().contains_point([0.0, 0.5])
    jc.plot.animate(run, seconds=0.2, fps=10).to_jshtml()
    # A moving one is drawn at its end, and a film moves it there.
    moving = jc.Shell([0.0, 0.5], 1.0, motion=jc.Steady([0.3, 0.0]))
    run = hit([moving, bodies[1]], 2.0, ELASTIC)
    ax = jc.plot.scene(run)
    ends = [line for line in ax.get_lines() if line.get_linestyle() == "--"]
    np.testing.assert_allclose(np.mean(ends[0].get_xdata()[:-1]), 0.6, atol=EXACT)
    animation = jc.plot.animate(run, seconds=0.2, fps=10)
    (solid,) = solids(animation.figure.axes[0])
    animation.to_jshtml()
    assert solid.get_path().contains_point([-0.42, 0.5])
    # A shaking one is followed.
    shakes = jc.Shell([0.0, 0.5], 1.0, motion=jc.Vibration([0.3, 0.0], 1.0))
    quarter = shakes.centre_at(np.array([0.0, 0.25]))
    np.testing.assert_allclose(quarter, [[0.0, 0.5], [0.3, 0.5]], atol=EXACT)
    bodies = [jc.Shell([0.5], 0.5), jc.Sphere(0.1, 1.0, [0.5], [1.0])]
    line = jc.plot.scene(hit(bodies, 2.0, ELASTIC))
    levels = {float(x.get_ydata()[0]) for x in line.get_lines() if len(x.get_xdata()) == 200}
    assert levels == {0.0, 1.0}
    assert line.get_ylim()[0] < 0 and line.get_ylim()[1] > 1


def test_what_shows_a_run_compiles_nothing(tmp_path):
    balls = [jc.Sphere(0.1, 1.0, [x, 0.5], [1.0, 0.3]) for x in (0.3, 0.6, 0.9)]
    run = hit([jc.Box([0.0, 0.0], [1.2, 1.2]), *balls], 0.3, gravity=[0.0, -9.81])

    def show():
        repr(run), repr(run.impacts), run.impacts.to_dict()
        run.at(0.1), run.at([0.1, 0.2])
        run.to_csv(io.StringIO()), run.impacts.to_csv(io.StringIO())
        jc.plot.scene(run), jc.plot.energy(run)
        jc.plot.animate(run, seconds=0.2).save(tmp_path / "run.gif", writer="pillow")

    assert work_of(show) == []

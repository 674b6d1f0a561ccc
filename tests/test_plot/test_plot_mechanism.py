"""Pictures and films of mechanisms, and of scenes whose spheres spin."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib import animation, colors
from matplotlib.collections import LineCollection, PathCollection
from PIL import Image

import jaxcontact as jc
from jaxcontact.plot._drawing.path import RunPath, turned

DURATION, DROP = 0.44, 0.2
TOUCH = np.sqrt(2 * DROP / 9.81)
FLOOR = np.array([[-1.0, 0.0], [1.0, 0.0]])
ARM = np.array([0.1, 0.0])
EXACT = 1e-12


@pytest.fixture(scope="module")
def hopper():
    """A point mass (x, y) that flies over a floor, and touches it at about 0.2 s."""
    system = jc.System(
        lambda t, q, args: jnp.eye(2), lambda t, q, v, args: jnp.stack([0.0 * args, -args]),
        lambda t, q, args: q[1:], law=jc.HuGuo(e=0.7), stiffness=1e11,
    )  # fmt: skip
    start = {"position": jnp.array([0.0, DROP]), "velocity": jnp.array([0.5, 0.0])}
    return jc.simulate(system, DURATION, **start, args=jnp.array(9.81))


def draw(q, args):
    assert float(args) == 9.81
    return q[None], [FLOOR, np.stack([q, q + ARM])]


def film_of(run, **how):
    film = jc.plot.animate(run, **how)
    # Matplotlib warns of an animation without any frame, once it is gone.
    film.figure.canvas.draw()
    return film


def parts(ax):
    """The dot, the lines, and the flashes of a film."""
    (dot,) = (line for line in ax.lines if line.get_marker() == "o")
    (lines,) = (c for c in ax.collections if isinstance(c, LineCollection))
    (flashes,) = (c for c in ax.collections if isinstance(c, PathCollection))
    return dot, lines, flashes


def test_a_film_of_a_mechanism(hopper, tmp_path):
    film = film_of(hopper, seconds=1.0, fps=11, draw=draw)
    film.save(tmp_path / "hop.gif")
    with Image.open(tmp_path / "hop.gif") as picture:
        assert picture.n_frames == 11
    (ax,) = film.figure.axes
    dot, lines, _ = parts(ax)
    for k, time in enumerate(np.linspace(0, DURATION, 11)):
        film._func(k)
        (place,) = hopper.at(time).position
        np.testing.assert_allclose(np.ravel(dot.get_data()), place, atol=EXACT)
        floor, arm = lines.get_segments()
        np.testing.assert_array_equal(floor, FLOOR)
        np.testing.assert_allclose(arm, [place, place + ARM], atol=EXACT)
        assert ax.get_title(loc="left") == f"$t$ = {time:.3f} s"
    # What does not move is lighter.
    light, dark = map(colors.to_rgb, lines.get_colors())
    assert sum(light) > sum(dark)
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    assert left < -1 and right > 1 and bottom < 0 and top > DROP and ax.get_aspect() == 1


def test_a_contact_flashes_at_its_place_and_fades(hopper):
    film = film_of(hopper, seconds=1.0, fps=441, draw=lambda t, q, args: draw(q, args))
    _, _, flashes = parts(film.figure.axes[0])
    (contact,) = hopper.contacts.to_dict()["duration"]
    sizes = {}
    for late in (-0.002, 0.001, 0.01, 0.02, 0.03):
        k = round((TOUCH + late) / 1e-3)
        film._func(k)
        sizes[late] = flashes.get_sizes().sum()
        if sizes[late]:
            place = hopper.at(1e-3 * k).position
            np.testing.assert_allclose(flashes.get_offsets(), place, atol=EXACT)
    assert contact < 1e-3 and sizes[-0.002] == sizes[0.03] == 0
    assert sizes[0.001] > sizes[0.01] > sizes[0.02] > 0


def test_films_that_cannot_be_made(hopper, tmp_path, monkeypatch):
    with pytest.raises(ValueError, match=r"`draw` must be a function draw\(q, args\) that returns"):
        jc.plot.animate(hopper)
    for wrong in (lambda q, args: q, lambda q, args: (q, []), lambda q, args: (q[None], [q])):
        with pytest.raises(ValueError, match=r"`draw` must return points \(P, 2\) and a list of"):
            jc.plot.animate(hopper, draw=wrong)
    with pytest.raises(ValueError, match="`axes` must be None for a mechanism"):
        jc.plot.animate(hopper, draw=draw, axes=(0, 1))
    nothing = np.zeros((0, 2))
    counts = iter(range(9))
    for wrong in (lambda q, args: (np.ones((next(counts), 2)), []), lambda q, args: (nothing, [])):
        with pytest.raises(ValueError, match="`draw` must return points or lines, and as many"):
            jc.plot.animate(hopper, draw=wrong)
    film_of(hopper, seconds=0.1, draw=lambda q, args: (np.ones((1, 2)), []))  # of no width
    film = film_of(hopper, seconds=0.1, draw=draw)
    monkeypatch.setattr(animation.writers, "is_available", lambda name: name == "pillow")
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(ValueError, match=r"end in \.gif, but is .*hop\.mp4': other films need ffm"):
        film.save(tmp_path / "hop.mp4")
    film.save(str(tmp_path / "hop.gif"))


def test_gaps_and_forces_have_names_and_short_numbers(hopper):
    ax = jc.plot.gaps(hopper, label="foot")
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["foot"]
    assert ax.get_ylabel() == "gap / m"
    ax = jc.plot.forces(hopper, label=["foot"])
    assert ax.get_ylabel() == "contact force / kN"
    with pytest.raises(ValueError, match="`label` must be a text or None, but is"):
        jc.plot.gaps(hopper, label=["foot", "hand"])


def test_a_phase_portrait_has_units(hopper):
    ax = jc.plot.phase(hopper, 1, units=("m", "m/s"), label="height")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("position 1 / m", "speed 1 / (m/s)")
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["height"]
    ax = jc.plot.phase(hopper)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("position 0", "speed 0")


def _incline_gaps(points, lines):
    along = lines[1][-1] - lines[1][0]
    away = np.array([-along[1], along[0]]) / np.hypot(*along)
    return (points - lines[1][0]) @ away


def _crank_gaps(points, lines):
    bearing, journal = (np.mean(line[:-1], axis=0) for line in lines[2:4])
    apart = np.hypot(*(journal - bearing))
    # The touch is on the bearing, in the direction of the journal.
    reach = np.hypot(*(points[0] - journal)) + apart
    assert reach == pytest.approx(10e-3) and np.ptp(lines[2][:, 0]) == pytest.approx(20e-3)
    return [np.ptp(lines[2][:, 0]) / 2 - np.ptp(lines[3][:, 0]) / 2 - apart]


@pytest.mark.parametrize(
    ("name", "q", "measured"),
    [
        ("bouncing_rod", [0.1, 0.2, 0.4], lambda points, lines: points[:, 1]),
        ("double_pendulum", [0.3, -0.2], lambda points, lines: points[:, 0] - lines[1][0, 0]),
        ("impact_damper", [0.002, 0.004], lambda x, y: (y[1][:2, 0] - x[:, 0]) * [1, -1]),
        ("shaken_incline", [0.01, 0.003], _incline_gaps),
        ("slider_crank", [-0.0868, 0.1686], _crank_gaps),
        (
            *("slider_in_guide", [0.5, -0.2, 0.01]),
            lambda x, y: np.where(np.arange(4) < 2, y[2][0, 1] - x[:, 1], x[:, 1] - y[3][0, 1]),
        ),
    ],
)
def test_ready_made_mechanisms_draw_their_gaps(name, q, measured):
    """The distances in the picture are the gaps."""
    system, _ = getattr(jc.systems, name)()
    t, q = 4e-4, np.array(q)
    points, lines = system.gap.draw(t, q, None)
    gaps = np.asarray(system.gap(jnp.asarray(t), jnp.asarray(q), None))
    assert points.shape == (len(gaps), 2)
    np.testing.assert_allclose(measured(points, lines), gaps, atol=1e-12)
    after = system.gap.draw(2 * t, q + 0.01, None)[1]
    assert [line.shape for line in after] == [line.shape for line in lines]


@pytest.fixture(scope="module")
def other():
    """A ball on a ring of 2 m, as another engine reports it: it rolls over the border."""
    scene = jc.Scene([jc.Sphere(0.1, 1.0, [1.8, 0.1])], jc.Hertz(), periodic=[2.0, None])
    position = np.array([[[1.8, 0.1]], [[2.0, 0.1]], [[0.2, 0.3]]]) % [2.0, 9.0]
    spin, energy = np.array([[-2.0], [-2.0], [-5.0]]), np.array([1.0, 0.8, 0.9])
    fields = {"position": position, "velocity": 0 * position, "energy": energy, "spin": spin}
    return jc.EngineRun(engine="other", time=np.array([0.0, 1.0, 2.0]), scene=scene, **fields)


def test_a_run_of_another_engine_is_joined_between_its_samples(other):
    ax = jc.plot.energy(other)
    assert ax.lines[0].get_drawstyle() == "default"
    film = film_of(other, seconds=0.5, fps=10)
    (ax,) = film.figure.axes
    film._func(3)  # of the five from 0 to 2 s
    np.testing.assert_allclose(ax.patches[0].center, [0.1, 0.2], atol=EXACT)
    # It has turned by -2 rad/s for 1.5 s.
    (marks,) = (c for c in ax.collections if isinstance(c, LineCollection))
    centre, rim = marks.get_segments()[0]
    np.testing.assert_allclose(rim - centre, 0.1 * np.array([np.cos(3), -np.sin(3)]), atol=EXACT)
    still = film_of(dataclasses.replace(other, spin=None), seconds=0.2, fps=10)
    still._func(1)
    marks = next(c for c in still.figure.axes[0].collections if isinstance(c, LineCollection))
    assert marks.get_segments() == []


def test_spins_turn_about_the_axis_that_points_at_the_viewer():
    time, place = np.array([0.0, 1.0]), np.zeros((2, 1, 3))
    path = RunPath(time, place, time, np.array([[[1.0, 2.0, 3.0]], [[9.0, 9.0, 9.0]]]))
    for shown, angle in {(0, 1): 3, (1, 2): 1, (2, 0): 2, (1, 0): -3, (0, 2): -2}.items():
        np.testing.assert_allclose(turned(path, np.array([0.5]), shown), [[angle / 2]])

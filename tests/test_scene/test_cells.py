"""Cells: hundreds of spheres against a plain search among all pairs, and never an overlap."""

from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._scene.arrays.arrays import layout_of
from jaxcontact._scene.arrays.from_scene import arrays_of, inputs_of
from jaxcontact._scene.contact_times.cells import grid_of
from jaxcontact._scene.engine import pieces as _pieces
from tests.test_scene.support import central, go, spheres

SAME = 1e-10  # times of impact against the search among all pairs, relative to the run
CHAOS = 1e-6  # states at the end: a rounding has grown in four impacts of every sphere

NAMES = "position", "velocity"

SMOOTH = 1e-6  # derivatives against central differences of the search among all pairs


class Space(NamedTuple):
    """Spheres of mass one, and where they are: in a box, in periodic space, in a shell."""

    size: tuple[float, ...]
    position: np.ndarray
    velocity: np.ndarray
    radius: np.ndarray
    duration: float
    e: float = 1.0
    gravity: tuple[float, ...] | None = None
    periodic: tuple[bool, ...] = (False,) * 3
    walls: tuple[bool, ...] = (False,) * 3
    shell: float = np.inf

    def around(self):
        return [x if p else None for x, p in zip(self.size, self.periodic, strict=False)]

    def scene(self):
        bodies = spheres(self.radius, 1.0, self.position, self.velocity)
        if any(self.walls):
            walls = np.array(self.walls[: len(self.size)])
            bodies.append(jc.Box(np.where(walls, 0.0, -np.inf), np.where(walls, self.size, np.inf)))
        if np.isfinite(self.shell):
            bodies.append(jc.Shell(np.array(self.size) / 2, self.shell))
        law = jc.ExactRestitution(e=self.e)
        return jc.Scene(bodies, law, gravity=self.gravity, periodic=self.around())


def space(size, count, duration, radius=0.5, drift=0.0, **options):
    empty = Space(size, *[np.zeros(0)] * 3, duration, **options)
    given = {"low": [0.0] * len(size), "high": size, "periodic": empty.around(), "radius": radius}
    drawn = jc.random_spheres(count, **given, mass=1.0, speed=1.0, seed=3)
    position, velocity = (np.array([getattr(s, k) for s in drawn]) for k in NAMES)
    velocity[:, 0] += drift
    radius = np.broadcast_to(radius, (count,))
    return empty._replace(position=position, velocity=velocity, radius=radius)


def first_root(a, b, c):
    """The first root of c + 2 b t + a t² where that falls, infinite without one."""
    square = b * b - a * c
    root = np.sqrt(np.maximum(square, 0))
    with np.errstate(divide="ignore", invalid="ignore"):
        time = np.where(
            b < 0, np.maximum(c, 0) / (root - b), np.where(a < 0, (-b - root) / a, np.inf)
        )
    return np.where((square >= 0) | (c <= 0), np.where((b < 0) | (a < 0), time, np.inf), np.inf)


def all_pairs(space, velocity=None):
    """Times, pairs and the state at the end, from a table of the times at which all pairs meet."""
    x, v = space.position.copy(), (space.velocity if velocity is None else velocity).copy()
    count, axes = x.shape
    lengths = np.where(space.periodic[:axes], space.size, 1e9)
    g = np.zeros(axes) if space.gravity is None else np.array(space.gravity)
    middle, now, times, pairs = np.array(space.size) / 2, 0.0, [], []
    faces = [(axis, side) for axis in np.flatnonzero(space.walls[:axes]) for side in (0, 1)]
    names = [*range(count), *(count + 2 * axis + side for axis, side in faces)]
    if np.isfinite(space.shell):
        names.append(count)

    def apart(k, other):
        away = x[k] - x[other]
        return away - lengths * np.round(away / lengths)

    def meets(k):
        away, rate = apart(k, slice(None)), v[k] - v
        c = np.sum(away**2, -1) - (space.radius[k] + space.radius) ** 2
        with_spheres = first_root(np.sum(rate**2, -1), np.sum(away * rate, -1), c)
        with_spheres[k] = np.inf
        found = [*with_spheres]
        for axis, side in faces:
            sign, place = 1 - 2 * side, side * space.size[axis]
            gap = sign * (x[k, axis] - place) - space.radius[k]
            found.append(first_root(sign * g[axis], sign * v[k, axis], 2 * gap))
        if np.isfinite(space.shell):
            out, square = x[k] - middle, np.sum(v[k] ** 2)
            room = max((space.shell - space.radius[k]) ** 2 - np.sum(out**2), 0)
            along = np.sum(out * v[k])
            found.append((np.sqrt(along**2 + square * room) - along) / square)
        return now + np.array(found)

    table = np.array([meets(k) for k in range(count)])
    while True:
        one, other = np.unravel_index(np.argmin(table), table.shape)
        time = min(table[one, other], space.duration)
        step = time - now
        x, v, now = x + (v + g / 2 * step) * step, v + g * step, time
        if time == space.duration:
            return np.array(times), np.array(pairs), x, v
        if other < count:
            normal, relative, share = apart(one, other), v[one] - v[other], 0.5
        else:
            flat = other < count + len(faces)
            normal = np.eye(axes)[faces[other - count][0]] if flat else x[one] - middle
            relative, share = v[one], 1.0
        normal = normal / np.sqrt(np.sum(normal**2))
        push = -(1 + space.e) * share * np.sum(relative * normal) * normal
        v[one] += push
        if other < count:
            v[other] -= push
            table[other] = meets(other)
            table[:count, other] = table[other, :count]
        table[one] = meets(one)
        table[:count, one] = table[one, :count]
        times.append(now)
        pairs.append(sorted((one, names[other])))


SPACES = {
    "between walls, periodic": lambda: space(
        (11.0,) * 3, 600, 0.3, e=0.9, periodic=(True, True, False), walls=(False, False, True)
    ),
    "two sizes in a shell": lambda: space(
        (22.0, 22.0), 320, 2.0, radius=np.where(np.arange(320) % 2, 0.5, 0.25), shell=25.0,
        drift=8.0,
    ),
}  # fmt: skip
GROWS = {"two sizes in a shell"}  # what leaves the place it starts from: cells on the rim get full


def grown(monkeypatch):
    """How often cells are made anew in runs from here on."""
    calls, made = [], _pieces._with_room
    monkeypatch.setattr(_pieces, "_with_room", lambda *given: calls.append(0) or made(*given))
    return calls


def compared(space, run):
    times, pairs, position, velocity = all_pairs(space)
    found = run.impacts.to_dict()
    assert len(found["time"]) == len(times) > 150
    np.testing.assert_allclose(found["time"], times, atol=SAME * space.duration)
    count = len(space.radius)
    second = np.where(found["face"] >= 0, count + found["face"], found["second"])
    met = np.sort(np.stack([found["first"], second], axis=1), axis=1)
    np.testing.assert_array_equal(met, pairs)
    np.testing.assert_allclose(run.position[-1], position, atol=CHAOS)
    np.testing.assert_allclose(run.velocity[-1], velocity, atol=CHAOS)


@pytest.mark.parametrize("kind", SPACES)
def test_cells_miss_nothing(monkeypatch, kind):
    space, calls = SPACES[kind](), grown(monkeypatch)
    scene = space.scene()
    model, _ = eqx.filter_jit(arrays_of)(inputs_of(scene), layout_of(scene), False, False)
    assert grid_of(model) is not None
    times = np.linspace(0, space.duration, 41)
    run = go(scene, space.duration, times=times)
    compared(space, run)
    assert (len(calls) > 0) == (kind in GROWS)
    distance = space.radius[:, None] + space.radius
    for places in np.asarray(run.position):
        apart = places[:, None] - places[None]
        size = np.where(space.periodic[: apart.shape[-1]], space.size, 1e9)
        apart -= size * np.round(apart / size)
        length = np.sqrt(np.sum(apart**2, axis=-1)) + 10 * np.eye(len(places))
        assert np.min(length - distance) > -1e-12


@pytest.mark.slow(reason="a scene with both searches in one program")
def test_traced_a_full_cell_sends_the_run_to_the_search_among_all():
    """The spheres fall along two walls: cells on the rim get full, and nothing shows but time."""
    given = {"e": 0.9, "gravity": (15.0, 0.0), "walls": (False, True)}
    flies, early = space((22.0, 22.0), 320, 1.5, **given), 0.3
    still, rng = flies.scene(), np.random.default_rng(0)
    direction = rng.normal(size=flies.velocity.shape)

    @jax.jit
    def run_of(velocity, along):
        def run(velocity):
            pairs = zip(still.spheres, velocity, strict=True)
            balls = [s.moved_to(s.position, v) for s, v in pairs]
            scene = eqx.tree_at(lambda scene: scene.bodies[: len(balls)], still, tuple(balls))
            times = [early, flies.duration]
            ran = go(scene, flies.duration, max_impacts=1000, times=times)
            return ran.position[0], ran

        _, slope, ran = jax.jvp(run, (velocity,), (along,), has_aux=True)
        return ran, slope

    run, slope = run_of(flies.velocity, direction)
    compared(flies, run)
    short = flies._replace(duration=early)
    expected = central(lambda h: all_pairs(short, short.velocity + h * direction)[2], 1e-6)
    np.testing.assert_allclose(slope, expected, atol=SMOOTH)

"""Cells: hundreds of spheres beside the search among all pairs, and never an overlap."""

import functools
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


def among_all(monkeypatch):
    """From here on no run has cells."""
    monkeypatch.setattr(_pieces, "grid_of", lambda *given: None)


def compared(space, run, plain):
    found, known = (each.impacts.to_dict() for each in (run, plain))
    assert len(found["time"]) == len(known["time"]) > 150
    np.testing.assert_allclose(found["time"], known["time"], atol=SAME * space.duration)
    met = [
        np.stack([x["face"], *np.sort([x["first"], x["second"]], axis=0)]) for x in (found, known)
    ]
    np.testing.assert_array_equal(*met)
    for name in NAMES:
        ends = [np.asarray(getattr(each, name))[-1] for each in (run, plain)]
        np.testing.assert_allclose(*ends, atol=CHAOS)


@pytest.mark.parametrize("kind", SPACES)
def test_cells_miss_nothing(monkeypatch, kind):
    space, calls = SPACES[kind](), grown(monkeypatch)
    scene = space.scene()
    model, _ = eqx.filter_jit(arrays_of)(inputs_of(scene), layout_of(scene), False, False)
    assert grid_of(model) is not None
    times = np.linspace(0, space.duration, 41)
    run = go(scene, space.duration, times=times)
    assert (len(calls) > 0) == (kind in GROWS)
    distance = space.radius[:, None] + space.radius
    for places in np.asarray(run.position):
        apart = places[:, None] - places[None]
        size = np.where(space.periodic[: apart.shape[-1]], space.size, 1e9)
        apart -= size * np.round(apart / size)
        length = np.sqrt(np.sum(apart**2, axis=-1)) + 10 * np.eye(len(places))
        assert np.min(length - distance) > -1e-12
    among_all(monkeypatch)
    compared(space, run, go(scene, space.duration))


@pytest.mark.slow(reason="a scene with both searches in one program")
def test_traced_a_full_cell_sends_the_run_to_the_search_among_all(monkeypatch):
    """The spheres fall along two walls: cells on the rim get full, and nothing shows but time."""
    given = {"e": 0.9, "gravity": (15.0, 0.0), "walls": (False, True)}
    flies, early = space((22.0, 22.0), 320, 1.5, **given), 0.3
    direction = np.random.default_rng(0).normal(size=flies.velocity.shape)

    def run(velocity, **how):
        scene = flies._replace(velocity=velocity).scene()
        ran = go(scene, flies.duration, times=[early, flies.duration], **how)
        return ran.position[0], ran

    @jax.jit
    def run_of(velocity, along):
        of = functools.partial(run, max_impacts=1000)
        return jax.jvp(of, (velocity,), (along,), has_aux=True)[1:]

    slope, ran = run_of(flies.velocity, direction)
    among_all(monkeypatch)
    compared(flies, ran, run(flies.velocity)[1])
    expected = central(lambda h: np.asarray(run(flies.velocity + h * direction)[0]), 1e-6)
    np.testing.assert_allclose(slope, expected, atol=SMOOTH)

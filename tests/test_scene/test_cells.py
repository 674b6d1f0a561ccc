"""Cells: the same impacts as without them, in every kind of space, and never an overlap."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._scene import _grid, _simulate
from jaxcontact._scene._grid import grid_of
from jaxcontact._scene._system import layout_of, numbers_of

SAME = 1e-12
"""Times of impact with and without cells, relative to the run; measured 2e-15."""

COUNT = 320
"""Enough for cells."""


def spheres(size, count=COUNT, periodic=None, radius=0.5, seed=3):
    low = [0.0] * len(size)
    given = {"low": low, "high": size, "mass": 1.0, "speed": 1.0, "periodic": periodic}
    return jc.random_spheres(count, radius=radius, seed=seed, **given)


def scene_of(kind):
    """Scenes, and how long some hundreds of impacts last in them."""
    elastic = jc.ExactRestitution(e=1.0)
    if kind == "box under gravity":
        size = [32.0, 20.0]
        bodies = [*spheres(size), jc.Box([0.0, 0.0], size)]
        return jc.Scene(bodies, jc.ExactRestitution(e=0.9), gravity=[0.0, -5.0]), 0.8
    if kind == "periodic":
        size = [32.0, 20.0]
        return jc.Scene(spheres(size, periodic=size), elastic, periodic=size), 1.0
    if kind == "nowhere":
        return jc.Scene(spheres([24.0, 24.0]), elastic), 4.0
    if kind == "periodic channel":
        size = [100.0, 6.5]
        bodies = [*spheres(size, periodic=(100.0, None)), jc.Box([-np.inf, 0.0], [np.inf, 6.5])]
        return jc.Scene(bodies, elastic, periodic=(100.0, None)), 0.5
    if kind == "sizes, a fixed one and a shell":
        radius = np.where(np.arange(COUNT) % 2, 0.5, 0.3)
        bodies = spheres([24.0, 24.0], radius=radius)
        post = jc.Sphere(0.5, position=[26.0, 12.0], fixed=True)
        return jc.Scene([*bodies, post, jc.Shell([12.0, 12.0], 20.0)], elastic), 1.0
    size = [9.0, 9.0, 9.0]
    return jc.Scene(spheres(size, periodic=size), elastic, periodic=size), 0.5


def impacts(run):
    """Who met whom, and when; first and second in either order."""
    pairs = np.sort(np.stack([run.impacts.first, run.impacts.second]), axis=0)
    return np.asarray(run.impacts.time), pairs


def with_and_without(monkeypatch, scene, duration, **options):
    layout = layout_of(scene)
    numbers, _ = numbers_of(scene, layout, contacts=False)
    assert grid_of(layout, numbers) is not None
    one = jc.simulate(scene, duration, instantaneous=True, **options)
    monkeypatch.setattr(_grid, "MANY", 10**9)
    assert grid_of(layout, numbers) is None
    return one, jc.simulate(scene, duration, instantaneous=True, **options)


@pytest.mark.parametrize(
    "kind",
    [
        "box under gravity",
        "periodic",
        "nowhere",
        "periodic channel",
        "sizes, a fixed one and a shell",
        "periodic in space",
    ],
)
def test_cells_change_nothing(monkeypatch, kind):
    scene, duration = scene_of(kind)
    cells, plain = with_and_without(monkeypatch, scene, duration)
    assert len(plain.impacts) == len(cells.impacts) > 200
    (time, pairs), (known, others) = impacts(cells), impacts(plain)
    np.testing.assert_allclose(time, known, atol=SAME * duration)
    np.testing.assert_array_equal(pairs, others)
    np.testing.assert_allclose(cells.velocity, plain.velocity, atol=1e-8)
    np.testing.assert_allclose(cells.margin.time, plain.margin.time, atol=SAME)

"""Shared by these tests: scenes of a few numbers, what is missing from a run, and differences."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc

GRAVITY = 9.81

SHOWN = "time position velocity energy spin impacts status reached wall_work sliding_loss _nearest"


def simulate(scene, duration, **options):
    """The run of a scene, in NumPy unless it is traced: parts of it then need no programs."""
    run = jc.simulate(scene, duration, **options)
    if isinstance(run.position, jax.core.Tracer):
        return run
    parts = {name: jax.tree.map(np.asarray, getattr(run, name)) for name in SHOWN.split()}
    return dataclasses.replace(run, **parts)


def go(scene, duration, **options):
    """The run of a scene with instantaneous impacts."""
    return jc.simulate(scene, duration, instantaneous=True, **options)


def _each(x, count):
    return [x] * count if not isinstance(x, list | tuple) and np.ndim(x) == 0 else x


def spheres(radius, mass, place, speed=None, spin=None, names=None):
    """Spheres from columns of their numbers; one number, or none, is that of all."""
    columns = [_each(x, len(place)) for x in (radius, mass, place, speed, spin, names)]
    rows = zip(*columns, strict=True)
    return [jc.Sphere(r, m, x, v, spin=w, name=name) for r, m, x, v, w, name in rows]


def in_a_line(radius, mass, place, speed, names=None):
    """Spheres on an axis."""
    return spheres(radius, mass, [(x,) for x in place], [(v,) for v in speed], None, names)


def bodies_of(balls, walls=()):
    """The bodies of a scene for those of the oracle."""
    planes = [jc.Plane(wall.point, wall.normal) for wall in walls]
    return [*(jc.Sphere(b.radius, b.mass, b.position, b.velocity) for b in balls), *planes]


@jax.jit
def apart(numbers):
    """The numbers of a vector, by one program, and so their slopes."""
    return tuple(numbers)


@jax.jit
def _flat(*arrays):
    return jnp.concatenate([array.ravel() for array in arrays])


def ended(run):
    """The last positions and velocities."""
    return _flat(run.position[-1], run.velocity[-1])


def missing(run):
    """The energy that is missing at the end of a run, beside what walls, impacts and sliding do."""
    lost = np.sum(run.impacts.energy_loss) + (run.sliding_loss or 0)
    return abs(run.energy[0] + run.wall_work - lost - run.energy[-1])


def central(of, step):
    """The slope at zero of a function, by a difference of order two."""
    return (of(step) - of(-step)) / (2 * step)


def fourth(of, step):
    """The same of order four."""
    return (8 * (of(step) - of(-step)) - (of(2 * step) - of(-2 * step))) / (12 * step)


def check_modes(function, numbers, sizes, step, within):
    """Check a derivative of weighed ends along a random direction, with steps of these `sizes`: in
    both modes, and beside differences. Return what else the function returns.
    """
    rng = np.random.default_rng(1)
    way = rng.normal(size=len(numbers)) * sizes
    # Not under `jit`: one program of all its parts compiles for three times as long.
    ends, forward, rest = jax.linearize(function, numbers, has_aux=True)
    weights, along = rng.normal(size=ends.size), np.asarray(forward(way))
    (slope,) = jax.linear_transpose(forward, numbers)(weights)
    differences = fourth(lambda h: np.asarray(function(numbers + h * way)[0]), step)
    np.testing.assert_allclose(along, differences, atol=within * np.max(np.abs(differences)))
    size = np.abs(weights) @ np.abs(along)
    np.testing.assert_allclose(np.asarray(slope) @ way, weights @ along, atol=1e-12 * size, rtol=0)
    return rest

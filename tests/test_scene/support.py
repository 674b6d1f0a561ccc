"""Shared by these tests: scenes of a few numbers, what is missing from a run, and differences."""

import numpy as np

import jaxcontact as jc

GRAVITY = 9.81


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

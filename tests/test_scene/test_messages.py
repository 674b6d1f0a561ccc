"""Bad input: every message names the argument, the allowed values, and the given value."""

import re

import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc

LAW = jc.Hertz()
STEEL = jc.Material(2e11, 0.3)
TWO = "`motion` must have 2 numbers, as the body"
ONE = "`displacement` must be a function that returns one"


def ball(x=0.0, **named):
    return jc.Sphere(**({"radius": 0.1, "mass": 1.0, "position": [x, 0.0]} | named))


def scene(*bodies, **named):
    return jc.Scene(list(bodies), **({"law": LAW} | named))


def driven(motion):
    return ball(mass=None, fixed=True, motion=motion)


def shell(motion):
    return jc.Shell([0.0, 0.0], 1.0, motion=motion)


def plane(motion):
    return jc.Plane([0.0, 0.0], [0.0, 1.0], motion=motion)


def prescribed(displacement):
    return jc.Prescribed(displacement, 1.0)


def run(duration=1.0, *walls, **named):
    made = scene(ball(position=[0.0, 1.0]), *walls)
    return jc.simulate(made, duration, **({"instantaneous": True} | named))


FAULTS = {
    "radius leaf": (lambda: ball(radius=jnp.asarray(-1.0)), "`radius` must be in (0, inf)"),
    "no mass": (lambda: ball(mass=None), "`mass` must be given for a sphere whose material"),
    "no density": (lambda: ball(mass=None, material=STEEL), "or give `material` with a density"),
    "fixed": (lambda: ball(fixed=True), "`mass` must be None for a sphere with `fixed=True`"),
    "fixed moves": (
        lambda: ball(mass=None, velocity=[1.0, 0.0], fixed=True),
        "`velocity` must be None for a sphere with `fixed=True`",
    ),
    "position": (lambda: ball(position=[0.0] * 4), "`position` must be one to three numbers"),
    "normal": (lambda: jc.Plane([0.0], [0.0]), "`normal` must not be zero, but is [0.0]"),
    "high": (lambda: jc.Box([0.0], [0.0]), "`high` must be above `low` = [0.0], but is [0.0]"),
    "bodies": (lambda: jc.Scene(ball(), LAW), "`bodies` must be a list of `Sphere`"),
    "a body": (lambda: scene(ball(), 3), "number 1 of it is 3"),
    "spaces": (
        lambda: scene(ball(), jc.Plane([0.0], [1.0])),
        "Plane (number 1) has 1 dimensions and Sphere (number 0) has 2",
    ),
    "nothing moves": (
        lambda: scene(jc.Sphere(0.1, position=[0.0], fixed=True)),
        "`bodies` must hold a sphere that is not fixed, but nothing in it moves",
    ),
    "overlap": (
        lambda: scene(ball(name="a"), ball(3.0), ball(0.15)),
        "Sphere 'a' (number 0) and Sphere (number 2) do, by 0.05 m",
    ),
    "overlap wall": (
        lambda: scene(ball(), jc.Plane([0.0, -0.07], [0.0, 2.0], name="table")),
        "Sphere (number 0) and Plane 'table' (number 1) do, by 0.03 m",
    ),
    "overlap image": (
        lambda: scene(ball(0.05), ball(0.95), periodic=[1.0, None]),
        "Sphere (number 0) and Sphere (number 1) do, by 0.1 m",
    ),
    "law key": (lambda: scene(ball(), law={3: LAW}), "`law` must have pairs of names"),
    "law names": (
        lambda: scene(ball(name="a"), law={("a", "b"): LAW}),
        "`law` must name bodies of the scene ('a'), but names 'b'",
    ),
    "law twice": (
        lambda: scene(ball(name="a"), ball(1.0, name="b"), law={("a", "b"): LAW, ("b", "a"): LAW}),
        "`law` must name a pair once, but names ('b', 'a') in both orders",
    ),
    "law missing": (
        lambda: scene(ball(name="a"), ball(1.0, name="b"), ball(2.0), law={("a", "b"): LAW}),
        "`law` must have an entry for 'a' and an unnamed body, which can meet",
    ),
    "Hertz": (lambda: scene(ball(), exponent=1.0), "`exponent` must be 1.5 where the stiffness"),
    "short period": (lambda: scene(ball(), periodic=[0.4, None]), "longer than four radii (0.4)"),
    "walled period": (
        lambda: scene(ball(), jc.Plane([0.0, -1.0], [0.0, 1.0]), periodic=[None, 3.0]),
        "`periodic` must be None for axis 1, along which Plane (number 1) ends the space",
    ),
    "times": (lambda: run(times=[0.5, 0.1]), "`times` must ascend, but is [0.5, 0.1]"),
    "late times": (lambda: run(times=[0.5, 1.1]), "`times` must lie between 0 and the duration"),
    "no stiffness": (
        lambda: jc.simulate(scene(ball(), law=jc.ConstantDamping(c=1.0)), 1.0, instantaneous=True),
        "`stiffness` of the scene must be given where a sphere has no material (number 0",
    ),
    "soft stiffness": (
        lambda: jc.simulate(scene(ball()), 1.0),
        "`stiffness` of the scene must be given where a sphere has no material (number 0",
    ),
    "not fixed": (
        lambda: ball(motion=jc.Steady([1.0, 0.0])),
        "`motion` must be None for a sphere without `fixed=True`",
    ),
    "motion of a sphere": (lambda: driven(jc.Steady([1.0])), TWO),
    "motion of a shell": (lambda: shell(jc.Vibration([0.1], 1.0)), TWO),
    "motion of a plane": (lambda: plane(jc.Steady([1.0])), TWO),
    "motion by a function": (lambda: plane(prescribed(lambda t, args: t[None])), TWO),
    "number for a shell": (
        lambda: shell(jc.Vibration(0.1, 1.0)),
        "`motion` of a shell must have a list of numbers as its",
    ),
    "number for a sphere": (
        lambda: driven(prescribed(lambda t, args: t)),
        "`motion` of a fixed sphere must have a list of numbers",
    ),
    "number for a box": (
        lambda: jc.Box([0.0], [1.0], motion=jc.Vibration(0.1, 1.0)),
        "`motion` of a box must have a list of numbers",
    ),
    "no array": (lambda: prescribed(lambda t, args: 1), ONE),
    "four numbers": (lambda: prescribed(lambda t, args: jnp.zeros(4)), ONE),
    "of time alone": (
        lambda: prescribed(lambda t: t),
        "`displacement` must be a function of the time and of",
    ),
    "walls meet": (
        lambda: run(5.0, plane(jc.Steady([0.0, 0.5])), jc.Plane([0.0, 2.0], [0.0, -1.0])),
        "but Plane (number 1) and Plane (number 2) meet at 4 s",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_messages(fault):
    call, words = FAULTS[fault]
    with pytest.raises(ValueError, match=re.escape(words)):
        call()


def test_what_may_overlap():
    """By rounding, and fixed bodies."""
    third = jc.Sphere(0.1, 1.0, [0.1 + 0.2])
    jc.Scene([jc.Sphere(0.1, 1.0, [0.1]), third, jc.Plane([0.0], [1.0])], LAW)
    pin = jc.Sphere(0.1, None, [0.0, 0.0], fixed=True)
    scene(pin, pin, ball(1.0), jc.Plane([0.0, 0.15], [0.0, -1.0]))


def test_a_law_out_of_range_is_flagged():
    bad = scene(ball(), law=jc.ExactRestitution(e=jnp.asarray(2.0)))
    done = jc.simulate(bad, 1.0, instantaneous=True, throw=False)
    assert done.status == jc.Ending.INVALID_INPUT and np.all(np.isnan(done.position))

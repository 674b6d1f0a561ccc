"""Mechanisms and their runs."""

import functools

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxcontact as jc
from tests.test_every_argument.case import COUNT, LAWS, NOTHING, UNSOLVED, Blank, Case
from tests.test_every_argument.kinds import (
    ARRAYS,
    CALLABLE,
    FLAG,
    INSIDE,
    JAX_SCALARS,
    NONE,
    POSITIVE,
    POSITIVES,
    REAL,
    REALS,
    TEXT,
)

ONE = frozenset({"shape (1,)", "jax shape (1,)"})
THREE = frozenset({"tuple", "range", "Series", "with nan"})
"""Kinds that are three numbers, which are checked when the mechanism starts."""
TIMES = ONE | {"tuple", "range", "Series", "empty list", "shape (0,)"}

FRICTION = jc.RegularizedCoulomb(mu=0.1, v_d=0.01)
CONTACT = {
    "law": LAWS,
    "stiffness": POSITIVES,
    "exponent": ARRAYS | JAX_SCALARS | {"one and a half"},
    "friction": NOTHING,
    "slip": CALLABLE,
}


def mass(t, q, args):
    return jnp.eye(3)


def force(t, q, v, args):
    return jnp.zeros(3)


def gap(t, q, args):
    return 1 + q[:1]


def slip(t, q, v, args):
    return v[:1]


def lagrangian(t, q, v, args):
    return jnp.sum(v**2) / 2


class Solved(jc.SystemRun):
    """A run whose states at other times are those it has."""

    def at(self, time):
        return self.states


@functools.cache
def a_run():
    """A run of zeros, which takes no solve."""
    one, two = jnp.zeros(1), jnp.zeros((1, 1))
    states = jc.SystemStates(one, two, two, two, two, two, one, one)
    contacts = jc.SystemContacts(*[one] * 8, valid=one == 0)
    end = jnp.ones(())
    return Solved(states, contacts, end, end, end, end, end, end, states)


def _drawn(draw, **given):
    """A picture of a run that is made when it is needed."""
    return draw(**(given if "run" in given else given | {"run": a_run()}))


@functools.cache
def cases() -> dict[str, Case]:
    system = jc.System(mass, force, gap, law=UNSOLVED, stiffness=1.0)
    rough = {"law": UNSOLVED, "stiffness": 1.0, "friction": FRICTION, "slip": slip}
    made = {"law": LAWS | NONE, "stiffness": POSITIVES}
    return {
        "System": Case(
            jc.System,
            {"mass": mass, "force": force, "gap": gap} | rough,
            CONTACT
            | {"mass": CALLABLE, "force": CALLABLE, "gap": CALLABLE, "rate": CALLABLE | NONE},
        ),
        "System.from_lagrangian": Case(
            jc.System.from_lagrangian,
            {"lagrangian": lagrangian, "gap": gap} | rough,
            CONTACT | {"lagrangian": CALLABLE, "gap": CALLABLE, "forces": CALLABLE | NONE},
        ),
        "simulate, a mechanism": Case(
            jc.simulate,
            {"model": system, "duration": 10.0, "position": [0.0] * 3, "velocity": [0.0] * 3},
            {
                "model": NOTHING,
                "duration": POSITIVE,
                "position": THREE,
                "velocity": THREE,
                "times": ONE | NONE | {"tuple", "range"},
                "rtol": INSIDE,
                "v0": POSITIVE,
                "breakpoints": TIMES,
                "max_impacts": COUNT | NONE,
                "throw": FLAG,
            },
        ),
        "SystemRun.at": Case(
            functools.partial(jc.SystemRun.at, Blank()),
            {},
            {"time": REALS - {"shape (2, 3)", "DataFrame"}},
            staged=True,
        ),
        "SystemRun.to_csv": Case(
            lambda path: a_run().to_csv(path), {}, {"path": TEXT - {"empty text"}}
        ),
        **{
            f"plot.{draw.__name__}": Case(
                functools.partial(_drawn, draw),
                {"ax": plt.figure().add_subplot()},
                {"run": NOTHING, "ax": NONE} | more,
            )
            for draw, more in (
                (jc.plot.gaps, {}),
                (jc.plot.forces, {}),
                (jc.plot.phase, {"coordinate": frozenset({"zero"})}),
            )
        },
        "SystemContacts.to_csv": Case(
            lambda path: a_run().contacts.to_csv(path), {}, {"path": TEXT - {"empty text"}}
        ),
        **{
            f"systems.{make.__name__}": Case(make, {"law": UNSOLVED}, made | more)
            for make, more in (
                (
                    jc.systems.double_pendulum,  # two numbers each
                    {"masses": NOTHING, "lengths": NOTHING, "angles": NOTHING}
                    | {"gravity": REAL, "wall": REAL},
                ),
                (
                    jc.systems.slider_crank,
                    {"lengths": NOTHING, "masses": NOTHING, "friction": NONE, "speed": REAL}
                    | {"clearance": POSITIVE, "inertia": POSITIVE, "bearing": POSITIVE},
                ),
                (
                    jc.systems.slider_in_guide,
                    {"lengths": NOTHING, "half_sizes": NOTHING, "friction": NONE}
                    | {"masses": THREE, "inertias": THREE, "speeds": THREE}
                    | {"clearance": POSITIVE, "gravity": REAL},
                ),
                (
                    jc.systems.bouncing_rod,
                    {"mass": POSITIVE, "length": POSITIVE, "radius": POSITIVE, "friction": NONE}
                    | {"gravity": REAL, "height": REAL, "angle": REAL},
                ),
                (
                    jc.systems.shaken_incline,
                    {"mass": POSITIVE, "shaking": NOTHING, "friction": NONE}
                    | {"tilt": REAL, "gravity": REAL},
                ),
                (
                    jc.systems.impact_damper,
                    {"masses": NOTHING, "shaking": NOTHING}
                    | {"clearance": POSITIVE, "spring": REAL, "damping": REAL},
                ),
            )
        },
    }

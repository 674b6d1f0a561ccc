"""Mechanisms and their runs."""

import functools

import jax.numpy as jnp

import jaxcontact as jc
from tests.test_every_argument.case import UNSOLVED, blank, case, drawn, method

FRICTION = jc.RegularizedCoulomb(mu=0.1, v_d=0.01)
MAYBE_THREE = "THREE or with nan"  # three numbers are checked when the mechanism starts


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


SLIDES = "NOTHING: friction; CALLABLE: slip"
MOVES = {"mass": mass, "force": force}
ROUGH = {"gap": gap, "stiffness": 1.0, "friction": FRICTION, "slip": slip}


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


def mechanism(name, positive, groups):
    return case(f"systems.{name}", f"POSITIVE: {positive}; {groups}", law=UNSOLVED)


@functools.cache
def cases():
    system = jc.System(mass, force, gap, law=UNSOLVED, stiffness=1.0)
    return [
        case("System", f"{SLIDES} mass force; CALLABLE or None: rate", **MOVES, **ROUGH),
        case(
            "System.from_lagrangian",
            f"{SLIDES} lagrangian; CALLABLE or None: forces",
            lagrangian=lagrangian,
            **ROUGH,
        ),
        case(
            "simulate, a mechanism",
            f"NOTHING: model; POSITIVE: duration v0; {MAYBE_THREE}: position velocity; "
            "ONE or None or tuple or range: times; INSIDE: rtol; "
            "ONE or THREE or empty list or shape (0,): breakpoints; WHOLE or None: max_impacts; "
            "FLAG: throw",
            **{"model": system, "duration": 10.0, "position": [0.0] * 3, "velocity": [0.0] * 3},
        ),
        method(blank(jc.SystemRun), "at", "REALS but shape (2, 3) or DataFrame: time", staged=True),
        case("SystemRun.to_csv", "", lambda path: a_run().to_csv(path)),
        *(drawn(name, a_run, "TEXT or list of text or None: label") for name in ("gaps", "forces")),
        drawn("phase", a_run, "zero: coordinate"),
        case("SystemContacts.to_csv", "", lambda path: a_run().contacts.to_csv(path)),
        case("SystemPhases.to_csv", "", jc.SystemPhases(*[jnp.ones(1, bool)] * 4).to_csv),
        mechanism("double_pendulum", "", "REAL: gravity wall"),
        mechanism("slider_crank", "inertia bearing", "REAL: speed"),
        mechanism("slider_in_guide", "", f"REAL: gravity; {MAYBE_THREE}: masses inertias speeds"),
        mechanism("bouncing_rod", "mass length radius", "REAL: gravity height angle"),
        mechanism("shaken_incline", "mass", "REAL: tilt gravity"),
        mechanism("impact_damper", "", "REAL: spring damping"),
    ]

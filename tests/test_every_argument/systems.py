"""Mechanisms and their runs."""

import functools

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxcontact as jc
from tests.test_every_argument.case import UNSOLVED, Blank, case

FRICTION = jc.RegularizedCoulomb(mu=0.1, v_d=0.01)
CONTACT = "law: law; POSITIVES: stiffness; EXPONENT: exponent; NOTHING: friction"
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


def _drawn(draw, **given):
    """A picture of a run that is made when it is needed."""
    return draw(**({"run": a_run()} | given))


def drawn(name, more=""):
    draw = functools.partial(_drawn, getattr(jc.plot, name))
    return case(
        f"plot.{name}", f"NOTHING: run; None: ax; {more}", draw, ax=plt.figure().add_subplot()
    )


def mechanism(name, positive, groups):
    groups = f"law or None: law; POSITIVES: stiffness; POSITIVE: {positive}; {groups}"
    return case(f"systems.{name}", groups, law=UNSOLVED)


@functools.cache
def cases():
    system = jc.System(mass, force, gap, law=UNSOLVED, stiffness=1.0)
    return [
        case(
            "System",
            f"{CONTACT}; CALLABLE: mass force gap slip; CALLABLE or None: rate",
            mass=mass,
            force=force,
            **ROUGH,
        ),
        case(
            "System.from_lagrangian",
            f"{CONTACT}; CALLABLE: lagrangian gap slip; CALLABLE or None: forces",
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
        case(
            "SystemRun.at",
            "REALS but shape (2, 3) or DataFrame: time",
            functools.partial(jc.SystemRun.at, Blank()),
            staged=True,
        ),
        case("SystemRun.to_csv", "NAME: path", lambda path: a_run().to_csv(path)),
        *(drawn(name, "TEXT or list of text or None: label") for name in ("gaps", "forces")),
        drawn("phase", "zero: coordinate; None: units; TEXT or None: label"),
        case("SystemContacts.to_csv", "NAME: path", lambda path: a_run().contacts.to_csv(path)),
        case("SystemPhases.to_csv", "NAME: path", jc.SystemPhases(*[jnp.ones(1, bool)] * 4).to_csv),
        mechanism("double_pendulum", "", "NOTHING: masses lengths angles; REAL: gravity wall"),
        mechanism(
            "slider_crank",
            "clearance inertia bearing",
            "NOTHING: lengths masses; None: friction; REAL: speed",
        ),
        mechanism(
            "slider_in_guide",
            "clearance",
            "NOTHING: lengths half_sizes; None: friction; REAL: gravity; "
            f"{MAYBE_THREE}: masses inertias speeds",
        ),
        mechanism(
            "bouncing_rod", "mass length radius", "None: friction; REAL: gravity height angle"
        ),
        mechanism("shaken_incline", "mass", "NOTHING: shaking; None: friction; REAL: tilt gravity"),
        mechanism("impact_damper", "clearance", "NOTHING: masses shaking; REAL: spring damping"),
    ]

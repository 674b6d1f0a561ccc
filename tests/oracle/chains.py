"""Chains of balls whose contacts have necks or memories, by a parameter and the first speed."""

import numpy as np

from tests.oracle import luding_chain, neck_chain, plastic_chain
from tests.oracle.luding_chain import Powder
from tests.oracle.neck_chain import Neck
from tests.oracle.plastic_chain import thornton
from tests.oracle.stored import stored

NECK = Neck(work=2 / (1.5 * np.pi), radius=1.0, modulus=7500.0)
GAPS = [1e-3, 5e-4]
LIGHT = 0.03 * np.array([1, 0.05, 0.2, 1])
"""Masses of which a light one between heavy ones is pressed several times."""
SHARED = LIGHT[:-1] * LIGHT[1:] / (LIGHT[:-1] + LIGHT[1:])


def _necks(pull_off, speed):
    neck = NECK._replace(work=NECK.work * pull_off / NECK.pull_off)
    found = neck_chain.follow([neck] * 2, [1.0, 1.0, 2.0], GAPS, [speed, 0.0, 0.0], 0.15)
    # The first ball stays at the second, and the neck to the third snaps.
    return found, [len(moments) for moments in found.moments] == [1, 2]


def _powder(adhesion, speed):
    powder, masses = Powder(1e5, 6.0, 200.0, adhesion), [1.0, 0.3, 2.0]
    found = luding_chain.follow([powder] * 2, masses, GAPS, [speed, 0.0, 0.0], 0.05)
    return found, found.shrunk > 1


def _pressed(contacts, speed, mass=LIGHT):
    """Without gaps."""
    starts = [speed, *[0.0] * (len(mass) - 1)]
    found = plastic_chain.follow(contacts, mass, np.zeros(len(contacts)), starts, 0.003)
    return found, np.sum(found.reloads) > 0


def _yielding(yields, speed):
    return _pressed([thornton(mass, 2e8, yields, 2e7) for mass in SHARED], speed)


def _lead_and_steel(yields, speed):
    found, _ = _pressed([thornton(0.015, 2e8, y) for y in (yields, 1e3)], speed, [0.03] * 3)
    return found, True


_CHAINS = {
    "necks": _necks, "powder": _powder, "yielding": _yielding, "lead and steel": _lead_and_steel,
}  # fmt: skip


@stored()
def ended(name, parameter, speed):
    """Velocities at the end, and whether that has happened what the chain is for."""
    found, happened = _CHAINS[name](parameter, speed)
    return found.velocity, bool(happened)

"""Steps of a slow mechanism with stiff contacts."""

from __future__ import annotations

import numpy as np

import jaxcontact as jc

MORE = 1.2
"""Steps of a run over those of the free motion and the contacts alone: .88 to 1.02, for ratios of
the periods to the contacts of 4e2 to 8e4 and rtol of 1e-6 and 1e-9."""


def test_stiff_contacts_cost_their_own_steps_only():
    # A period of some 2 s, and contacts of 2.4e-5 s.
    system, start = jc.systems.double_pendulum(stiffness=5.6e12)
    away, _ = jc.systems.double_pendulum(stiffness=5.6e12, wall=-5.0)
    how = {"v0": "touch", "max_impacts": 16}
    run = jc.simulate(system, 2.5, **start, **how)
    table = run.contacts.to_dict()
    assert len(table["time"]) == 3 and np.max(table["duration"]) < 2.5e-5
    free = jc.simulate(away, 2.5, **start, **how)
    assert len(free.contacts.to_dict()["time"]) == 0
    steps = int(free.steps)
    touched = run.at(table["time"])
    for k, duration in enumerate(table["duration"]):
        at_touch = {"position": touched.position[k], "velocity": touched.velocity[k]}
        steps += int(jc.simulate(system, duration * (1 + 1e-9), **at_touch, **how).steps)
    assert int(run.steps) < MORE * steps

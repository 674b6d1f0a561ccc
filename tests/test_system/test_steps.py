"""Steps of a slow mechanism with stiff contacts."""

from __future__ import annotations

import numpy as np

import jaxcontact as jc

MORE = 1.2
"""Steps of a run over those of its flights and contacts alone: .85 to 1.01, for periods of 4e2 to
8e4 contacts and rtol from 1e-6 to 1e-11."""


def test_stiff_contacts_cost_their_own_steps_only():
    # A period of some 2 s, and contacts of 2.4e-5 s.
    system, start = jc.systems.double_pendulum(stiffness=5.6e12)
    how = {"v0": "touch", "max_impacts": 16}
    run = jc.simulate(system, 2.5, **start, **how)
    table = run.contacts.to_dict()
    assert len(table["time"]) == 3 and np.max(table["duration"]) < 2.5e-5

    def steps_alone(begin, end):
        states = run.at(begin)
        starts = zip(states.position, states.velocity, end - begin, strict=True)
        return sum(
            int(jc.simulate(system, lasts, position=q, velocity=v, **how).steps)
            for q, v, lasts in starts
        )

    touch, lasts = table["time"], table["duration"]
    contacts = steps_alone(touch, touch + lasts * (1 + 1e-9))
    flights = steps_alone(np.append(0, touch + lasts * (1 + 1e-6)), np.append(touch - 1e-13, 2.5))
    assert int(run.steps) < MORE * (contacts + flights)


def test_the_end_of_a_run_costs_few_steps():
    """Also where the forces depend on time, which stands still beyond the end."""
    system, start = jc.systems.slider_crank()
    how = {"v0": "touch", "max_impacts": 16}
    counts = [int(jc.simulate(system, 1e-4 * k, **start, **how).steps) for k in range(1, 7)]
    # In flight before the first contact, and after it: 4, 5, 39, 39, 39 and 40 steps.
    assert counts[0] < 10
    assert max(counts[2:]) - min(counts[2:]) < 5
    told, how = [], how | start
    seen = jc.simulate(system, 6e-4, **how, progress=lambda *said: told.append(said)).final
    np.testing.assert_array_equal(seen.position, jc.simulate(system, 6e-4, **how).final.position)
    assert told == [(1, None)]

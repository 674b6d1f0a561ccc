"""The energy of a mechanism closes over some 200 contacts."""

from __future__ import annotations

import numpy as np
import pytest

import jaxcontact as jc

RTOL = 1e-9

CLOSES = 10 * RTOL
"""Of the imbalance over the energy: .02 to 1.5 rtol in runs of 104 to 601 contacts."""


@pytest.mark.parametrize(
    ("build", "how", "duration"),
    [
        (jc.systems.impact_damper, {"shaking": (2e-3, 31.6)}, 11.0),
        # Its last contacts last for much of a turn; how many there are is a matter of chaos.
        (jc.systems.slider_crank, {}, 0.28),
    ],
    ids=["impact damper", "slider-crank"],
)
def test_energy_closes_over_200_contacts(build, how, duration):
    system, start = build(**how)
    run = jc.simulate(system, duration, **start, rtol=RTOL, v0="touch")
    lost = run.contacts.to_dict()["energy_loss"]
    assert len(lost) >= 200
    gained, work = (float(x[-1] - x[0]) for x in (run.energy, run.states.work))
    assert abs(gained - work + np.sum(lost)) < CLOSES * max(run.energy[-1], np.sum(lost))

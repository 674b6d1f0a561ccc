"""Steps of a slow mechanism with stiff contacts, and the energy of one over some 200 contacts."""

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


MORE = 1.2
"""Steps of a run over those of its flights and contacts alone: .85 to 1.01, for periods of 4e2 to
8e4 contacts and rtol from 1e-6 to 1e-11."""

ROUNDING = 1e-10
"""That of places up to 30 m in contacts of .1 mm: 4e-14 to 1e-11 for places up to 1000 m."""


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


def _pushed_into_a_damper(place, push):
    """A mass of 1 kg flies .1 m to a stop whose damping ~ δ^(1/4) soon exceeds the push."""
    law = jc.Jankowski(0.7)
    system = jc.System(
        lambda t, q, x: np.eye(1),
        lambda t, q, v, x: x["push"] + 0 * q,
        lambda t, q, x: x["place"] + 0.1 - q,
        law=law, stiffness=1e4, exponent=1.5,
    )  # fmt: skip
    args, start = {"push": push, "place": place}, {"position": [place], "velocity": [1.0]}
    return jc.simulate(system, 0.2, **start, args=args, rtol=1e-10)


def test_a_peak_within_the_rounding_of_the_gap_is_found():
    """The place of a stop changes neither steps nor rebound; it hides how the force begins."""
    for push in (0.003, 0.01):
        runs = [_pushed_into_a_damper(place, push) for place in (0.0, 1.0, 30.0)]
        assert max(int(run.steps) for run in runs) < 200  # 94 to 112
        e = [float(run.contacts.restitution[0]) for run in runs]
        np.testing.assert_allclose(e, e[0], rtol=ROUNDING)

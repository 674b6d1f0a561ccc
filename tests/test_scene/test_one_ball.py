"""A scene of one ball on a floor is a bouncing ball: two programs that share only the laws."""

import numpy as np

import jaxcontact as jc

SAME = 1e-8
"""Ten times `rtol`."""


def test_a_scene_of_one_ball_bounces_as_bounce_does():
    """Soft enough that the weight is felt in every contact, down to the one that never ends."""
    law, mass, stiffness, height = jc.HuGuo(e=0.6), 0.03, 1e5, 0.02
    known = jc.bounce(
        law,
        jc.Contact(mass, stiffness),
        height,
        bounces=12,
        gravity_in_contact=True,
        v0="touch",
        method=jc.Event(rtol=1e-10),
    )
    rests = int(np.argmax(np.asarray(known.status) == jc.Status.SETTLED))
    assert rests >= 3
    scene = jc.Scene(
        [jc.Sphere(0.01, mass, position=[height + 0.01]), jc.Plane([0.0], [1.0])],
        law,
        stiffness=stiffness,
        gravity=[-9.81],
    )
    run = jc.simulate(scene, float(known.rest_time) + 0.2, v0="touch")
    hits = run.impacts.to_dict()
    assert len(run.impacts) == rests + 1
    flying = slice(0, rests)
    for ours, theirs in (
        ("time", known.time),
        ("closing_speed", known.impact_velocity),
        ("restitution", known.restitution),
        ("duration", known.duration),
    ):
        np.testing.assert_allclose(hits[ours][flying], theirs[flying], rtol=SAME, err_msg=ours)
    np.testing.assert_allclose(hits["time"][rests], known.time[rests], rtol=SAME)
    # It goes on, and swings about the static indentation.
    assert np.isnan(hits["restitution"][rests])
    sunk = 0.01 - run.position[-1, 0, 0]
    assert abs(sunk - known.rest_indentation) < 0.5 * known.rest_indentation

"""A scene of one ball on a floor against `bounce`: two programs that share only the laws."""

import numpy as np
import pytest

import jaxcontact as jc

SAME = 1e-8
"""Ten times `rtol`: measured 3e-10."""

BALLS = {
    # Soft enough that the weight matters in every contact, down to the one that never ends.
    "soft": (jc.HuGuo(e=0.6), 0.03, 1e5, 1.5, 0.02),
    # Its force vanishes at a depth, from which the ball rises under its weight.
    "only pushes": (jc.KelvinVoigt(e=0.5, tension=False), 1.0, 1e3, 1.0, 0.1),
}


@pytest.mark.slow(reason="a soft scene and a bounce to rest")
@pytest.mark.parametrize(("law", "mass", "stiffness", "n", "height"), BALLS.values(), ids=BALLS)
def test_a_scene_of_one_ball_bounces_as_bounce_does(law, mass, stiffness, n, height):
    """With the defaults of both: damping refers to the largest closing speed."""
    contact, how = jc.Contact(mass, stiffness, n), jc.Event(rtol=1e-10)
    known = jc.bounce(law, contact, height, gravity_in_contact=True, method=how)
    assert known.at_rest
    rests = known.status.shape[0] - 1
    bodies = [jc.Sphere(0.01, mass, position=[height + 0.01]), jc.Plane([0.0], [1.0])]
    scene = jc.Scene(bodies, law, stiffness=stiffness, exponent=n, gravity=[-9.81])
    run = jc.simulate(scene, float(known.rest_time) + 0.2)
    hits = run.impacts.to_dict()
    assert len(run.impacts) == rests + 1
    # The closing speed of a coupled solve is the v0 of the law; e is relative to it.
    rebound = hits["closing_speed"] * hits["restitution"]
    # That of `bounce` is at δ = 0; here it is where the force vanishes, from where the ball flies.
    flown = known.restitution * known.impact_velocity + 9.81 * (known.return_time - known.duration)
    ours, theirs = (hits["time"], rebound, hits["duration"]), (known.time, flown, known.duration)
    for one, other in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(one[:rests], other[:rests], rtol=SAME)
    np.testing.assert_allclose(hits["time"][rests], known.rest_time, rtol=SAME)
    # It continues, and oscillates about the static indentation.
    assert np.isnan(hits["restitution"][rests])
    sunk = 0.01 - run.position[-1, 0, 0]
    assert abs(sunk - known.rest_indentation) < 0.5 * known.rest_indentation

"""Published numbers by whole runs with impacts of finite duration."""

import numpy as np

import jaxcontact as jc

GLASS = jc.Material(youngs_modulus=48e9, poisson_ratio=0.20, density=2800.0)
ALUMINIUM = jc.Material(youngs_modulus=70e9, poisson_ratio=0.30, density=2699.0)


def followed(balls, duration):
    """Elastic balls beside a plane at 0, as many in all tests, which share their programs so."""
    far = [
        jc.Sphere(0.01, position=[50.0 + k], velocity=[0.0], material=GLASS)
        for k in range(5 - len(balls))
    ]
    scene = jc.Scene([*balls, *far, jc.Plane([0.0], [1.0])], jc.Hertz())
    return jc.simulate(scene, duration)


def test_spheres_of_glass_and_of_aluminium():
    """Cases 1 and 2 of Chung & Ooi (2011), doi 10.1007/s10035-011-0277-0, far from each other: two
    equal spheres, by the closed form, and one on a rigid plane.
    """
    balls = [
        jc.Sphere(0.01, position=[9.98], velocity=[10.0], material=GLASS),
        jc.Sphere(0.01, position=[10.02], velocity=[-10.0], material=GLASS),
        jc.Sphere(0.1, position=[0.11], velocity=[-0.2], material=ALUMINIUM),
    ]
    run = followed(balls, 0.1)
    hits = run.impacts.to_dict()
    assert hits["solved_by"].tolist() == [jc.SolvedBy.CLOSED_FORM] * 2
    np.testing.assert_allclose(hits["max_force"], [10696.889, 11369.858], rtol=5e-8)
    np.testing.assert_allclose(hits["duration"], [4.03394557e-5, 7.31656641e-4], rtol=5e-9)
    np.testing.assert_allclose(run.velocity[-1, :3, 0], [-10.0, 10.0, 0.2], rtol=1e-12)


def test_the_hertz_chain():
    """Five equal balls that just touch, and one that is struck: any K and m."""
    places = [1 + 0.02 * k for k in range(5)]
    speeds = [1.0, 0.0, 0.0, 0.0, 0.0]
    balls = [
        jc.Sphere(0.01, position=[x], velocity=[v], material=GLASS)
        for x, v in zip(places, speeds, strict=True)
    ]
    run = followed(balls, 0.01)
    speeds = [-0.0710850, -0.0302738, -0.0144636, 0.1270450, 0.9887774]
    np.testing.assert_allclose(run.velocity[-1, :, 0], speeds, atol=1e-7)
    assert np.all(run.impacts.solved_by == jc.SolvedBy.COUPLED)
    # The lost energy is that of the errors alone.
    np.testing.assert_allclose(run.energy[-1], run.energy[0], rtol=1e-8)


RECORDED = 4e-5
"""What Exudyn's steps leave of its rebounds, by the difference to the closed form: 3.4e-5."""


def test_the_rebounds_that_exudyn_recorded():
    """Its contact of Hunt and Crossley, asked for these e at 10 m/s, in steps; and the closed form,
    to all digits that are given.
    """
    asked = [0.9, 0.8, 0.5, 0.3, 0.1]
    recorded = [0.9090299, 0.8329035, 0.6629838, 0.5813176, 0.5158574]
    exact = [0.9090157, 0.8328698, 0.6629622, 0.5812880, 0.5158326]
    ball, wall = jc.Sphere(0.01, 0.03, [0.02], [-10.0]), jc.Plane([0.0], [1.0])
    runs = [
        jc.simulate(jc.Scene([ball, wall], jc.HuntCrossley(e=e), stiffness=1e8), 0.005)
        for e in asked
    ]
    rebounds = np.array([float(run.velocity[-1, 0, 0]) / 10 for run in runs])
    np.testing.assert_allclose(rebounds, recorded, rtol=0, atol=RECORDED)
    np.testing.assert_allclose(rebounds, exact, rtol=0, atol=6e-8)
    np.testing.assert_allclose([run.impacts.restitution[0] for run in runs], rebounds, rtol=1e-12)

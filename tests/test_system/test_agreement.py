"""Mechanisms against other methods: scenes, SciPy restarted at events, other forms of equations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_system.references import restarted

LAW = jc.HuGuo(e=0.7)
ALPHA = 1.5 * 0.3 / 0.7
"""Hu & Guo (2015), equation 38: α = 3 (1 - e)/(2 e)."""

LARGEST = 2e-6
"""Of the largest force at rtol=1e-9: 2e-7 by its interpolation, and less than 1e-6 by the spacing
of the states. A summit between the first two samples of a step was 1.6e-5 too low."""


def assert_touches_of_scipy(run, mass, force, gap, start, stiffness, duration):
    touches, _, _ = restarted(lambda t, q: mass, force, gap, start, duration, stiffness, ALPHA)
    table = run.contacts.to_dict()
    assert len(touches) == len(table["time"]) >= 2
    gaps, times, speeds = zip(*touches, strict=True)
    np.testing.assert_array_equal(table["gap"], gaps)
    np.testing.assert_allclose(table["time"], times, rtol=1e-8)
    np.testing.assert_allclose(table["closing_speed"], speeds, rtol=1e-7)


def test_impact_damper_is_that_of_scipy():
    system, start = jc.systems.impact_damper(shaking=(2e-3, 31.6))
    run = jc.simulate(system, 0.8, **start, rtol=1e-11, v0="touch")

    def gap(t, q):
        return np.array([0.005 + q[1] - q[0], 0.005 + q[0] - q[1]])

    def force(t, q, v):
        base, pace = 2e-3 * np.sin(31.6 * t), 2e-3 * 31.6 * np.cos(31.6 * t)
        return np.array([-1000 * (q[0] - base) - 0.5 * (v[0] - pace), 0])

    start = np.zeros(2), np.zeros(2)
    assert_touches_of_scipy(run, np.diag([1.0, 0.1]), force, gap, start, 1e7, 0.8)


def test_rod_is_that_of_scipy():
    system, start = jc.systems.bouncing_rod()
    run = jc.simulate(system, 0.7, **start, rtol=1e-11, v0="touch")

    def gap(t, q):
        return q[1] + 0.1 * np.sin(q[2]) * np.array([-1, 1]) - 0.01

    def force(t, q, v):
        return np.array([0.0, -0.981, 0.0])

    inertia = np.diag([0.1, 0.1, 0.1 * 0.2**2 / 12])
    start = np.array([0.0, 0.3, 0.5]), np.zeros(3)
    assert_touches_of_scipy(run, inertia, force, gap, start, 1e7, 0.7)


def lagrangian(t, q, v, args):
    x = jnp.cumsum(jnp.sin(q)), jnp.cumsum(jnp.cos(q) * v)
    y = jnp.cumsum(-jnp.cos(q)), jnp.cumsum(jnp.sin(q) * v)
    kinetic = jnp.sum(jnp.square(x[1]) + jnp.square(y[1])) / 2
    return kinetic - 9.81 * jnp.sum(y[0])


def to_wall(t, q, args):
    return jnp.cumsum(jnp.sin(q)) + 0.3


@pytest.fixture(scope="module")
def pendulum():
    system = jc.System.from_lagrangian(lagrangian, to_wall, law=LAW, stiffness=1e7)
    start = {"position": [1.0, 1.5], "velocity": [0.0, 0.0], "v0": "touch"}
    return jc.simulate(system, 2.3, **start, times=np.linspace(0, 2.3, 24))


PEAK = 3e-7
"""The largest force, found between the steps of the default rtol, errs by up to 1.2e-7."""


def test_lagrangian_gives_the_same_motion(pendulum):
    system, start = jc.systems.double_pendulum()
    run = jc.simulate(system, 2.3, **start, v0="touch")
    ours, others = (each.contacts.to_dict() for each in (run, pendulum))
    np.testing.assert_array_equal(ours["gap"], others["gap"])
    np.testing.assert_allclose(ours["time"], others["time"], rtol=1e-9)
    np.testing.assert_allclose(ours["max_force"], others["max_force"], rtol=PEAK)


def test_energy_of_a_lagrangian_is_complete(pendulum):
    """The total energy falls by the losses of contacts alone."""
    table, energy = pendulum.contacts.to_dict(), np.asarray(pendulum.energy)
    touch, over = table["time"][None], (table["time"] + table["duration"])[None]
    time = np.asarray(pendulum.time)[:, None]
    assert not np.any((time > touch) & (time < over))
    lost = np.sum(np.where(time > over, table["energy_loss"][None], 0), axis=1)
    np.testing.assert_allclose(energy + lost, energy[0], atol=1e-8 * 40)


def test_depth_and_force_are_those_of_one_impact(pendulum):
    """Closing speed and effective mass at touch decide a short contact up to the weight."""
    table = pendulum.contacts.to_dict()
    # Mass 2 pushes along its own rod and the first.
    q = np.asarray(pendulum.at(table["time"][0]).position[0])
    gradient = np.cos(q)
    inertia = np.array([[2.0, np.cos(q[0] - q[1])], [np.cos(q[0] - q[1]), 1.0]])
    mass = 1 / (gradient @ np.linalg.solve(inertia, gradient))
    alone = jc.impact(LAW, jc.Contact(mass, 1e7), table["closing_speed"][0])
    names = {"max_force": "max_force", "max_depth": "max_indentation", "restitution": "restitution"}
    for name, expected in names.items():
        np.testing.assert_allclose(table[name][0], getattr(alone, expected), rtol=1e-2)


def test_three_balls_are_those_of_a_scene():
    heights, radius, mass = [0.03, 0.075, 0.13], 0.02, 0.1
    balls = [jc.Sphere(radius, mass, position=[h], velocity=[0.0]) for h in heights]
    plane, how = jc.Plane(point=[0.0], normal=[1.0]), {"law": LAW, "stiffness": 1e7}
    scene = jc.Scene([*balls, plane], gravity=[-9.81], **how)
    of_scene = jc.simulate(scene, 0.2, rtol=1e-10, v0="touch")

    def gap(t, q, args):
        return jnp.stack([q[0] - radius, q[1] - q[0] - 2 * radius, q[2] - q[1] - 2 * radius])

    system = jc.System(
        lambda t, q, args: mass * jnp.eye(3), lambda t, q, v, args: free_fall(t, q, v, args) * mass,
        gap, **how,
    )  # fmt: skip
    start = {"position": heights, "velocity": [0.0, 0.0, 0.0]}
    run = jc.simulate(system, 0.2, **start, rtol=1e-10, v0="touch")
    ours, others = run.contacts.to_dict(), of_scene.impacts.to_dict()
    assert len(ours["time"]) == len(others["time"]) >= 5
    np.testing.assert_allclose(ours["time"], others["time"], rtol=1e-8)
    for name in ("closing_speed", "restitution", "duration", "energy_loss"):
        np.testing.assert_allclose(ours[name], others[name], rtol=1e-6, err_msg=name)
    np.testing.assert_allclose(ours["max_force"], others["max_force"], rtol=1e-3)
    np.testing.assert_allclose(run.final.position, of_scene.position[-1, :, 0], atol=1e-9)


def free_fall(t, q, v, args):
    return jnp.full_like(v, -9.81)


def unit(t, q, args):
    return jnp.eye(q.shape[0], dtype=q.dtype)


def moving_floor(t, q, args):
    return q - args["amplitude"] * jnp.sin(40 * t)


def falling_on_a_floor(duration=0.6, **how):
    system = jc.System(unit, free_fall, moving_floor, law=LAW, stiffness=1e6)
    start = {"position": [0.1], "velocity": [0.0], "args": {"amplitude": 0.01}}
    return jc.simulate(system, duration, **start, v0="touch", **how)


def test_floor_that_moves_is_that_of_scipy():
    run = falling_on_a_floor(rtol=1e-11)

    def gap(t, q):
        return q - 0.01 * np.sin(40 * t)

    def force(t, q, v):
        return np.array([-9.81])

    start = np.array([0.1]), np.array([0.0])
    assert_touches_of_scipy(run, np.eye(1), force, gap, start, 1e6, 0.6)
    # Kinetic energy changes by the work of weight and floor, less the losses.
    losses = np.sum(run.contacts.to_dict()["energy_loss"])
    balance = run.energy[-1] - run.energy[0] - run.states.work[-1] + losses
    assert abs(float(balance)) < 1e-9


def test_states_at_times_are_those_of_shorter_runs():
    run = falling_on_a_floor()
    for time in (0.05, 0.2, 0.45):
        states = run.at(time), falling_on_a_floor(time).final
        for got, expected in zip(*map(jax.tree.leaves, states), strict=True):
            np.testing.assert_allclose(got[0], expected, rtol=1e-7, atol=1e-9)


def test_largest_force_is_that_of_states():
    """Also where the summit lies just behind the start of a step, as in the fourth contact."""
    system, start = jc.systems.slider_crank()
    run = jc.simulate(system, 1.2e-3, **start, v0="touch")
    table = run.contacts.to_dict()
    for k in range(4):
        times = table["time"][k] + table["duration"][k] * np.linspace(0, 1, 2001)
        force = np.asarray(run.at(times).force[:, 0])
        # Off the summit by at most half a spacing.
        np.testing.assert_allclose(table["max_force"][k], np.max(force), rtol=LARGEST)

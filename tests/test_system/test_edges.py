"""Starts, ends, wrong input, batches and precisions of mechanisms."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_system.references import free_fall, unit

LAW = jc.HuGuo(e=0.7)


def height(t, q, args):
    return q


WEIGHT = 0.05  # the weight changes e of a soft contact by a few hundredths
SLIDES = 1e-13  # two sums of one force over time: measured 4e-15

BALL = jc.System(unit, free_fall, height, law=LAW, stiffness=1e6)


def fall(duration=0.1, **how):
    return jc.simulate(BALL, duration, **{"position": [0.0], "velocity": [-1.0]} | how)


def test_touching_at_the_start_is_a_touch_at_once():
    table = fall().contacts.to_dict()
    assert table["time"][0] == 0 and table["closing_speed"][0] == 1
    alone = jc.impact(LAW, jc.Contact(1.0, 1e6), 1.0)
    assert table["restitution"][0] == pytest.approx(float(alone.restitution), rel=WEIGHT)


@pytest.mark.parametrize(
    ("start", "end"),
    [({"velocity": [1.0]}, 0.1 - 9.81 * 0.01 / 2), ({"position": [1.0], "velocity": [0.0]}, None)],
    ids=["touching and leaving", "far away"],
)
def test_gap_that_never_closes_is_flight(start, end):
    run = fall(**start)
    assert len(run.contacts) == 0 and run.ok
    assert run.margin.closing_speed == jnp.inf
    np.testing.assert_allclose(run.final.velocity[0], start["velocity"][0] - 0.981, rtol=1e-12)
    if end:
        np.testing.assert_allclose(run.final.position[0], end, rtol=1e-12)


def test_pressed_at_the_start_needs_a_v0():
    with pytest.raises(ValueError, match=r"Gap 0 is -0.001 m at the start"):
        fall(position=[-1e-3], velocity=[0.0], v0="touch")
    run = fall(0.015, position=[-1e-3], velocity=[0.0], v0=0.5)
    # Unloading from rest: ½ v² gains the elastic energy less losses.
    assert 0 < float(run.final.velocity[0]) < np.sqrt(2 * 1e6 * 1e-3**2.5 / 2.5)


@pytest.mark.parametrize("part", [1.0, 3.0], ids=["static", "released"])
def test_pressed_and_at_rest_needs_a_number(part):
    """Without a closing speed there is no peak; a number is the speed of the damping."""
    start = {"position": [-part * (9.81 / 1e6) ** (2 / 3)], "velocity": [0.0]}
    with pytest.raises(ValueError, match=r"Gap 0 .* does not close.*`v0` as a number"):
        fall(**start)
    assert fall(**start, v0=0.1).ok


def test_contact_for_all_time_comes_to_rest():
    """A ball that bounces down: contacts follow each other until it stays at its static depth."""
    run = fall(3.0, position=[0.01], velocity=[0.0])
    table = run.contacts.to_dict()
    assert np.isnan(table["duration"][-1]) and np.all(np.isfinite(table["duration"][:-1]))
    assert str(run.margin).count("\n") == 0
    # Dots stand for rows that are hidden.
    for rows, lines in ((13, 16), (14, 17)):
        text = str(jax.tree.map(lambda x: np.resize(x, rows), run.contacts))  # noqa: B023
        assert (len(text.splitlines()), "..." in text) == (lines, rows == 14)
    np.testing.assert_allclose(-run.final.position[0], (9.81 / 1e6) ** (2 / 3), rtol=1e-4)
    assert float(run.error_estimate) < 1e-6


def rubs(friction, slip=lambda t, q, v, args: v):
    return {"friction": friction, "slip": slip}


class Own(jc.AbstractFriction):
    mu: jax.Array
    kappa: float = 0.5  # the name is free

    def rebound(self, problem):
        raise AssertionError("mechanisms do not ask for it")


def of_kind(kind, **more):
    return type("Own", (Own,), {"kind": kind} | more)(0.3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": lambda t, q, args: jnp.zeros((1, 1))}, "positive definite"),
        ({"mass": lambda t, q, args: jnp.ones(1)}, r"`mass` must return the shape \(1, 1\)"),
        ({"gap": lambda t, q, args: q * jnp.nan}, "gap 0 is nan"),
        ({"gap": lambda t, q, args: jnp.sqrt(q - q)}, "gradient of `gap` must be finite.*gap 0"),
        ({"gap": lambda t, q, args: q[0]}, r"`gap` must return an array of the shape \(m,\)"),
        ({"force": lambda t, q, v, args: v * jnp.nan}, "`force` must be finite"),
        ({"mass": lambda t, q, args: jnp.eye(1, dtype=int)}, "`mass` .* real floats, but .* int"),
        ({"force": lambda t, q, v, args: v.astype(complex)}, "`force` .* complex.* of the shape"),
        ({"gap": lambda t, q, args: [q]}, "`gap` must return .* but returns a list"),
        ({"friction": jc.RegularizedCoulomb(0.1, 0.1)}, "`slip` must be given"),
        (rubs(jc.RigidCoulomb(0.1), lambda t, q, v, args: v**2), "`slip` must be affine in v"),
        (rubs(jc.RigidCoulomb([0.1, 0.2])), "each of 1 gaps, .* shape .2,"),
        (
            rubs(jc.RigidCoulomb(0.3), lambda t, q, v, args: jnp.stack([v, v], 1)),
            r"`slip` must return the shape \(1,\) with `RigidCou",
        ),
        (rubs(jc.WaltonFriction(0.3, 0.4)), "WaltonFriction.*outcome of an impact"),
        (rubs(jc.MawBarberFawcett(0.3)), "MawBarberFawcett.*outcome of an impact"),
        (rubs(jc.SpringSlider(0.3)), r"`ratio` of the `SpringSlider`.*no materials"),
        (rubs(of_kind("glass")), "'state', but is a `Own` of the kind 'glass'.*outcome"),
        (rubs(of_kind("spring")), "`ratio` of the `Own` of a `System` must be given"),
        (rubs(of_kind("ramp")), "`force` of the `Own` of a `System` must be given"),
        (rubs(of_kind("state")), "`force_and_rate` of the `Own` of a `System` must be given"),
        (rubs(of_kind("state", force_and_rate=len)), "`unit` of the `Own` of a `System` must"),
        (
            rubs(of_kind("state", unit=1.0, force_and_rate=lambda law, f, u, z: u)),
            r"`force_and_rate` must return force and rate of the shape \(1,\), but returns \[\(1,",
        ),
        (
            rubs(jc.SpringSlider(0.3, 1.0, form="rescaled")),
            r'`form` of the `SpringSlider`.*"force", but is "rescaled',
        ),
        (
            rubs(jc.RigidCoulomb(0.1)) | {"law": jc.JKR(pull_off=2.0)},
            "must be a law whose bodies do not stick",
        ),
    ],
)
def test_wrong_systems_are_named(change, message):
    parts = {"mass": unit, "force": free_fall, "gap": height, "law": LAW, "stiffness": 1e6} | change
    with pytest.raises(ValueError, match=message):
        jc.simulate(jc.System(**parts), 0.1, position=[0.1], velocity=[0.0])


@pytest.mark.parametrize("kind", ["rigid", "ramp"])
def test_a_friction_law_of_ones_own_takes_mu_of_the_impulse(kind):
    """Of a ball without weight that slides all along, Δv_t = μ Δv_n."""
    law = of_kind(kind, force=lambda law, normal, slip: -law.mu * normal * jnp.sign(slip))
    how = rubs(law, lambda t, q, v, args: v[:1]) | {"law": LAW, "stiffness": 1e6}
    system = jc.System(unit, lambda t, q, v, args: 0 * v, lambda t, q, args: q[1:], **how)
    run = jc.simulate(system, 0.1, position=[0.0, 0.01], velocity=[5.0, -1.0])
    along, off = map(float, run.final.velocity)
    assert along > 0 and 5.0 - along == pytest.approx(0.3 * (off + 1.0), rel=SLIDES)


def test_lagrangian_must_be_quadratic():
    system = jc.System.from_lagrangian(
        lambda t, q, v, args: jnp.sum(v**2 + v**4), height, law=LAW, stiffness=1e6
    )
    with pytest.raises(ValueError, match="quadratic"):
        jc.simulate(system, 0.1, position=[0.1], velocity=[1.0])


@pytest.mark.parametrize(("name", "use"), [("q0", "position"), ("t_eval", "times")])
def test_names_of_other_libraries_are_explained(name, use):
    with pytest.raises(TypeError, match=f"no argument `{name}`.*`{use}=`"):
        fall(**{name: 1.0})


def test_arguments_of_scenes_are_refused():
    with pytest.raises(ValueError, match="`instantaneous` must be left out for a `System`"):
        fall(instantaneous=True)
    scene = jc.Scene([jc.Sphere(0.1, 1.0, position=[0.0])], law=LAW, stiffness=1e6)
    with pytest.raises(ValueError, match="`position` must be left out for a `Scene`"):
        jc.simulate(scene, 1.0, position=[1.0])


def test_bad_lane_leaves_its_neighbours_alone():
    def ends(position):
        run = fall(0.3, position=position[None], velocity=[0.0], throw=False)
        return run.status, run.final.position[0], run.contacts.closing_speed[0]

    places = jnp.array([0.1, jnp.nan, 0.2])
    status, end, speed = jax.vmap(ends)(places)
    np.testing.assert_array_equal(status == jc.Ending.COMPLETED, [True, False, True])
    assert np.isnan(end[1]) and np.isnan(speed[1])
    for k in (0, 2):
        _, *alone = ends(places[k])
        np.testing.assert_allclose([end[k], speed[k]], alone, rtol=1e-9)


def test_capacity_is_flagged():
    how = {"position": [0.1], "velocity": [0.0], "max_impacts": 2}
    assert fall(1.5, **how, throw=False).status == jc.Ending.TOO_MANY_IMPACTS
    with pytest.raises(jc.NumericalError, match="max_impacts"):
        fall(1.5, **how)


def test_breakpoints_are_where_force_jumps():
    """A thrust that stops at 0.05 s, below the resolution of no step."""

    def thrust(t, q, v, args):
        return jnp.where(t < 0.05, 100.0, 0.0) + jnp.zeros_like(v)

    system = jc.System(unit, thrust, lambda t, q, args: 10 - q, law=LAW, stiffness=1e6)
    how = {"position": [0.0], "velocity": [0.0]}
    run = jc.simulate(system, 0.1, **how, breakpoints=[0.05])
    np.testing.assert_allclose(run.final.velocity[0], 5.0, rtol=1e-13)
    assert int(run.steps) < int(jc.simulate(system, 0.1, **how, breakpoints=[0.09]).steps)


def quaternion_rate(t, q, v, args):
    """Return q' = ½ q ⊗ (0, v), with angular velocities v in the body."""
    w, x, y, z = q
    matrix = jnp.stack([-x, -y, -z, w, -z, y, z, w, -x, -y, x, w]).reshape(4, 3)
    return matrix @ v / 2


def test_positions_may_be_quaternions():
    """A body that turns about one axis until its arm of 1 m touches a floor."""
    system = jc.System(
        lambda t, q, args: jnp.diag(jnp.array([1.0, 2.0, 3.0])),
        lambda t, q, v, args: jnp.zeros(3),
        lambda t, q, args: (0.5 + 2 * (q[1] * q[3] - q[0] * q[2]))[None],
        law=jc.Hertz(), stiffness=1e6, rate=quaternion_rate,
    )  # fmt: skip
    start = {"position": [1.0, 0.0, 0.0, 0.0], "velocity": [0.0, 1.0, 0.0]}
    run = jc.simulate(system, 1.0, **start, rtol=1e-11)
    table = run.contacts.to_dict()
    # The arm is at sin(angle) = ½ when it touches.
    np.testing.assert_allclose(table["time"][0], np.pi / 6, rtol=1e-10)
    np.testing.assert_allclose(table["restitution"][0], 1, rtol=1e-8)
    np.testing.assert_allclose(jnp.sum(run.final.position**2), 1, rtol=1e-9)


def test_single_precision():
    single = jax.tree.map(lambda x: x.astype(jnp.float32) if eqx.is_inexact_array(x) else x, BALL)
    how = {"position": np.float32([0.1]), "velocity": np.float32([0.0])}
    run = jc.simulate(single, np.float32(0.3), **how, rtol=1e-4)
    assert run.final.position.dtype == jnp.float32
    double = fall(0.3, position=[0.1], velocity=[0.0])
    ours, others = (each.contacts.to_dict()["time"] for each in (run, double))
    np.testing.assert_allclose(ours, others, rtol=1e-4)


SCATTER = 20  # steps of 50 runs of a rod that differ by rounding, 176 to 190, differ by up to 14


BUILDS = {
    "guide": (lambda part: jc.systems.slider_in_guide(stiffness=1e10 * (1 + part)), 3e-3, 2),
    "rod": (lambda part: jc.systems.bouncing_rod(height=0.3 * (1 + part), angle=0.0), 1.0, 8),
}


@pytest.mark.parametrize(("build", "duration", "contacts"), BUILDS.values(), ids=BUILDS)
def test_gaps_close_and_open_together(build, duration, contacts):
    """Both corners, or ends, meet a plane at once; rounding alone decides which is the first."""
    parts = jnp.asarray(np.random.default_rng(0).normal(size=50) * 1e-13)

    def outcome(part):
        system, start = build(part)
        run = jc.simulate(system, duration, **start, v0="touch", max_impacts=16, throw=False)
        return run.status, run.contacts.valid, run.contacts.gap, run.steps

    status, valid, gap, steps = map(np.asarray, jax.jit(jax.vmap(outcome))(parts))
    assert np.all(status == jc.Ending.COMPLETED)
    assert np.all(valid.sum(axis=1) == contacts)
    assert np.all((valid & (gap == 0)).sum(axis=1) == contacts // 2)
    # No step is wasted on the rounding between them.
    assert np.ptp(steps) <= SCATTER


TOUCH = 1e-11  # times of touch at rtol 1e-9, relative: measured 1e-12


def drive(t, q, v, args):
    one, ten, square, step, spring = args[:5]
    waves = one * jnp.sin(t) + ten * jnp.sin(10 * t)
    return waves + square * t**2 + step * jnp.where(t < 1, 0.0, 1.0) - spring * q


def wall(t, q, args):
    far, cubic, shaken = args[5:]
    return far - cubic * t**3 + shaken * jnp.cos(t) - q


def test_starts_at_rest_without_forces():
    """The first touches: closed forms, and the root of (10 sin t - sin 10 t)/99 = .05."""
    lanes = {
        1.93456321075: [1, 0, 0, 0, 0, 1.0, 0, 0],
        12**0.25: [0, 0, 1, 0, 0, 1.0, 0, 0],
        1 + 2**0.5: [0, 0, 0, 1, 0, 1.0, 0, 0],
        0.4200584211237859: [0, 1, 0, 0, 1, 0.05, 0, 0],
        0.5 ** (1 / 3): [0, 0, 0, 0, 1, 0.05, 0.1, 0],
        np.arccos(-5 / 6): [0, 0, 0, 0, 0, 0.5, 0, 0.6],
    }
    system = jc.System(unit, drive, wall, law=LAW, stiffness=1e4)

    def first_touch(args):
        start = {"position": [0.0], "velocity": [0.0], "args": args, "breakpoints": [1.0]}
        run = jc.simulate(system, 2.6, **start, throw=False)
        return run.contacts.time[0], run.ok

    times, ok = jax.jit(jax.vmap(first_touch))(jnp.array(list(lanes.values()), float))
    assert np.all(ok)
    np.testing.assert_allclose(times, list(lanes), rtol=TOUCH)


def test_runs_that_end_before_their_time():
    """NaN and negative numbers begin at given times; a mass of q - .005 vanishes on the way."""

    def of_time(t, value, usual):
        return jnp.where(t > 0.03, value, usual)

    system = jc.System(
        lambda t, q, a: jnp.eye(1) * of_time(t, a[0], 1.0) * jnp.where(a[3] > 0, q[0] - 0.005, 1.0),
        lambda t, q, v, a: of_time(t, a[1], -9.81) + a[4] * v * jnp.abs(v),
        lambda t, q, a: q + of_time(t, a[2], 0.0),
        law=LAW,
        stiffness=1e6,
    )
    nan, ends = np.nan, jc.Ending
    lanes = {
        (1, -9.81, 0, 0, 0): (ends.COMPLETED, 0.04),
        (-1, -9.81, 0, 0, 0): (ends.SINGULAR_MASS, 0.03),
        (nan, -9.81, 0, 0, 0): (ends.NOT_FINITE, 0.03),
        (1, nan, 0, 0, 0): (ends.NOT_FINITE, 0.03),
        (1, -9.81, nan, 0, 0): (ends.NOT_FINITE, 0.03),
        (1, -9.81, 0, 1, 0): (ends.SINGULAR_MASS, 0.0020007620406),
        (1, -9.81, 0, 0, 1e5): (ends.TOO_MANY_STEPS, None),
    }

    def ended(args):
        start = {"position": [0.01], "velocity": [0.0], "args": args}
        run = jc.simulate(system, 0.04, **start, throw=False)
        return run.status, run.reached

    status, reached = jax.jit(jax.vmap(ended))(jnp.array(list(lanes), float))
    for got, at, (expected, when) in zip(status, reached, lanes.values(), strict=True):
        assert got == expected
        assert when is None or abs(at - when) < 1e-12

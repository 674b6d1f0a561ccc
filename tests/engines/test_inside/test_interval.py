"""The contacts of one step, without an engine: e, derivatives, coupled pairs, and the step rule."""

import contextlib
import io
import sys
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxcontact as jc
from docs.run_code import BLOCK, DOCS
from jaxcontact.engines.inside.interval import Gaps, push_of
from tests.engines.test_inside.rebound import HERTZ, LINEAR
from tests.test_impact.support import both_jacobians

SPEEDS = (0.5, 3.0)

DIFFERENCES = 1e-6  # of derivatives from central differences with steps of 1e-5: 3e-8 measured
COUPLED = 1e-6  # of the speeds of three balls after 200 steps, from a solve by SciPy: 8e-8 measured


def bounce(law, contact, velocity, step, phase, substeps=1, steps=64):
    """The speed ratio of a ball on a wall, in steps of its own that end off the touch."""

    def advance(state, _):
        depth, speed, carry = state
        gaps = Gaps(depth, speed, jnp.zeros(1), jnp.ones((1, 1)) / contact.mass)
        push = push_of(law, contact, gaps, carry, step, substeps)
        depth = depth + step * speed - push.shift / contact.mass
        return (depth, speed - push.impulse / contact.mass, push.touch_speed), None

    start = jnp.reshape(-phase * velocity * step, (1,)), jnp.reshape(velocity, (1,)), jnp.zeros(1)
    return -jax.lax.scan(advance, start, length=steps)[0][1][0] / velocity


@pytest.mark.parametrize(
    ("law", "contact"),
    [(jc.HuGuo(e=0.8), HERTZ), (jc.KelvinVoigt(e=0.5), LINEAR)],
    ids=["hu_guo", "kelvin_voigt"],
)
@pytest.mark.parametrize("substeps", [1, 8])
def test_the_stated_step_keeps_e(law, contact, substeps):
    # None of the sixteen phases that the rule examines.
    phases = jnp.linspace(0.03, 0.99, 13)
    step = jc.mjx.time_step(law, contact, SPEEDS, error=0.01, substeps=substeps)

    def of(velocity):
        at = jax.vmap(lambda phase: bounce(law, contact, velocity, step, phase, substeps))
        return at(phases)

    e = jax.jit(jax.vmap(of))(jnp.asarray(SPEEDS))
    np.testing.assert_allclose(e, jc.restitution(law, contact, 1.0), rtol=0.01)
    # The rule is no worse than it has to be.
    durations = jc.impact(law, contact, jnp.asarray(SPEEDS)).duration
    assert durations.min() / step < 5 / substeps


def test_derivatives_are_those_of_differences():
    def of(x):
        law = jc.ConstantDamping(c=3e5 * x[0])
        contact = jc.Contact(mass=0.5 * x[1], stiffness=1e6 * x[2])
        return bounce(law, contact, 2.0 * x[3], jnp.asarray(1e-3), 0.37)

    x, small = jnp.ones(4), 1e-5
    ahead = jax.jit(jax.vmap(of))
    start, shifts = jnp.ones((4, 4)), small * jnp.eye(4)
    expected = (ahead(start + shifts) - ahead(start - shifts)) / (2 * small)
    for slopes in jax.jit(partial(both_jacobians, of))(x)[1:]:
        np.testing.assert_allclose(slopes, expected, rtol=DIFFERENCES, atol=DIFFERENCES)


def test_pairs_that_share_a_ball_are_solved_together():
    # Three balls in a line; the pairs share the middle one.
    masses = np.array([0.1, 0.2, 0.3])
    closing = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
    answers = (closing / masses).T
    law = jc.Damped(alpha=0.4)
    contact = jc.Contact(mass=0.1, stiffness=1e6)
    start = np.array([-1e-4, -3e-4]), np.array([1.0, 0.0, 0.0])
    step = 2e-5

    def advance(state, _):
        depth, speed, carry = state
        rate = jnp.asarray(closing) @ speed
        gaps = Gaps(depth, rate, jnp.zeros(2), jnp.asarray(closing @ answers))
        push = push_of(law, contact, gaps, carry, jnp.asarray(step), 1)
        depth = depth + step * rate - gaps.yields @ push.shift
        return (depth, speed - jnp.asarray(answers) @ push.impulse, push.touch_speed), None

    begin = (*map(jnp.asarray, start), jnp.zeros(2))
    speed = jax.jit(lambda s: jax.lax.scan(advance, s, length=200)[0][1])(begin)

    # The package's v0 is the largest closing speed since touch; until its touch each one grows.
    v0 = np.array([1.0, 1e-9])

    def fall(_, y):
        rate = closing @ y[2:]
        np.maximum(v0, rate, out=v0)
        force = 1e6 * np.maximum(y[:2], 0) ** 1.5 * np.maximum(1 + 0.4 * rate / v0, 0)
        return np.concatenate([rate, -answers @ force])

    exact = {"rtol": 1e-10, "atol": 1e-13, "method": "DOP853", "max_step": 1e-6}
    end = solve_ivp(fall, (0, 0.004), np.concatenate(start), **exact)
    np.testing.assert_allclose(speed, end.y[2:, -1], atol=COUPLED)
    np.testing.assert_allclose(masses @ speed, 0.1, rtol=1e-12)


def test_laws_with_memory_or_adhesion_are_refused_by_name():
    for law in (
        jc.ThorntonPlastic(yield_speed=0.1),
        jc.Luding(ratio=2.0, slope=1e3, adhesion=0.1),
        jc.JKR(0.1),
        jc.WetRestitution(e=0.8, critical_speed=0.1),
    ):
        with pytest.raises(ValueError, match=type(law).__name__):
            jc.mjx.time_step(law, HERTZ, 1.0)


@pytest.mark.parametrize("change", [jax.jit, jax.grad, lambda f: lambda x: jax.vmap(f)(x[None])])
@pytest.mark.parametrize("name", ["law", "contact", "velocity"])
def test_a_traced_argument_is_named_with_what_to_do(name, change):
    given = {"law": jc.HuGuo(e=0.8), "contact": HERTZ, "velocity": 1.0}

    def step(x):
        own = {"law": jc.HuGuo(e=x), "contact": jc.Contact(x, 1e6), "velocity": x}
        return jc.mjx.time_step(**(given | {name: own[name]}))

    words = f"`{name}` must have concrete numbers, but is traced .* Call `time_step` outside"
    with pytest.raises(ValueError, match=words):
        change(step)(jnp.asarray(0.8))


def test_concrete_arguments_serve_under_jit():
    law = jc.HuGuo(e=0.8)
    step = jc.mjx.time_step(law, HERTZ, SPEEDS)
    inside = jax.jit(lambda x: x * jc.mjx.time_step(law, HERTZ, SPEEDS))(jnp.asarray(1.0))
    assert float(inside) == step


def test_an_error_out_of_reach_is_refused(monkeypatch):
    rule = sys.modules["jaxcontact.engines.inside.time_step"]
    assert rule._MOST == 4096
    monkeypatch.setattr(rule, "_MOST", 64.0)
    with pytest.raises(ValueError, match="that 64 substeps in a contact reach"):
        jc.mjx.time_step(jc.AntypovElliott(e=0.5), HERTZ, 1.0, error=1e-9)


@pytest.mark.parametrize(
    ("engine", "module", "package"),
    [(jc.mjx, "mujoco", "mujoco-mjx"), (jc.jaxsim, "jaxsim", "jaxsim")],
    ids=["mjx", "jaxsim"],
)
def test_without_the_engine_the_command_is_named(monkeypatch, engine, module, package):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=f"pip install {package}`"):
        engine.contact_force(jc.Hertz(), HERTZ, None)


PRINTED = 1e-3  # of the numbers of the page, which other versions of the engines may change


@pytest.mark.engines
@pytest.mark.usefixtures("usual_promotion")
@pytest.mark.parametrize(("engine", "module"), [("mjx", "mujoco.mjx"), ("jaxsim", "jaxsim")])
def test_the_code_of_the_page(engine, module):
    pytest.importorskip(module)
    page = (DOCS / "engines.md").read_text(encoding="utf-8")
    (block,) = (m for m in BLOCK.finditer(page) if f"{engine}.contact_force" in m["code"])
    shown, names = io.StringIO(), {}
    with contextlib.redirect_stdout(shown):
        exec(block["code"], names)
    printed = [float(word) for word in shown.getvalue().split()]
    expected = [float(word) for word in block["shown"].split()]
    np.testing.assert_allclose(printed, expected, rtol=PRINTED)

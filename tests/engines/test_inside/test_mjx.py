"""Balls in MJX with the contacts of this package: e, derivatives, several bodies, refusals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.engines.test_inside.rebound import GRAVITY, after, require_derivatives

pytestmark = [pytest.mark.engines, pytest.mark.usefixtures("usual_promotion")]

BALL = """
<mujoco>
  <option gravity="0 0 {gravity}"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body pos="0 0 .05">
      <freejoint/>
      <geom name="ball" type="sphere" size=".05" mass="0.5"/>
    </body>
    {more}
  </worldbody>
</mujoco>
"""
OTHER = """
<body pos="{x} 0 {z}"><freejoint/>
  <geom name="other" type="{kind}" size=".05 .05 .05" mass="1"/></body>
"""
HERTZ = jc.Contact(mass=0.5, stiffness=1e6)
LINEAR = jc.Contact(mass=0.5, stiffness=1e5, exponent=1)
SPEEDS = (0.5, 1.0, 3.0)

ERROR = 0.01  # of e, which the time step is chosen for
REST = 1e-6  # in m, of the depth at rest: 5e-9 measured


def made(gravity=0.0, more=""):
    mujoco = pytest.importorskip("mujoco")
    pytest.importorskip("mujoco.mjx")
    return mujoco.MjModel.from_xml_string(BALL.format(gravity=gravity, more=more))


def moved(model, law, contact, step, height, velocity, steps, **options):
    """Positions and velocities (steps, n) of bodies of which the first falls at this speed."""
    from mujoco import mjx

    acting = jc.mjx.contact_force(law, contact, model, **options)
    engine = acting.model.tree_replace({"opt.timestep": step})
    data = mjx.make_data(acting.model)
    data = data.replace(qpos=data.qpos.at[2].add(height), qvel=data.qvel.at[2].set(-velocity))

    def advance(state, _):
        data, carry = acting.step(engine, *state)
        return (data, carry), (data.qpos, data.qvel)

    return jax.lax.scan(advance, (data, acting.init(engine, data)), length=steps)[1]


@pytest.mark.parametrize(
    ("laws", "contact"),
    [
        (jc.HuGuo(e=jnp.array([0.8, 0.5])), HERTZ),
        (jc.ConstantDamping(c=jnp.array([1e5, 4e5])), HERTZ),
    ],
    ids=["hu_guo", "constant_damping"],
)
def test_a_ball_has_the_restitution_of_its_law(laws, contact):
    model = made()

    @jax.jit
    @jax.vmap
    def rebound(law, step, velocity, phase):
        speeds = moved(model, law, contact, step, phase * velocity * step, velocity, 40)[1]
        return speeds[-1, 2] / velocity

    each = [jax.tree.map(lambda x, k=k: x[k], laws) for k in (0, 1)]
    lanes = [(law, v, phase) for law in each for v in SPEEDS for phase in (0.1, 0.6)]
    steps = [jc.mjx.time_step(law, contact, v, error=ERROR) for law, v, _ in lanes]
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *[law for law, _, _ in lanes])
    v, phase = (jnp.array([lane[k] for lane in lanes]) for k in (1, 2))
    expected = [jc.restitution(law, contact, speed) for law, speed, _ in lanes]
    e = rebound(stacked, jnp.array(steps), v, phase)
    np.testing.assert_allclose(e, jnp.array(expected), rtol=ERROR)


def test_derivatives_of_the_rebound_height():
    model = made(gravity=-GRAVITY)

    def end(law, contact, step, height, velocity):
        q, v = moved(model, law, contact, step, height, velocity, 200)
        return q[-1, 2] - 0.05, v[-1, 2]

    require_derivatives(end, 0.1)


def test_mujoco_keeps_the_other_geoms():
    model = made(gravity=-9.81, more=OTHER.format(kind="box", x=1, z=0.05))
    acting = jc.mjx.contact_force(jc.HuGuo(e=0.3), HERTZ, model, geoms=["ball"])
    assert acting.pairs == (("floor", "ball"), ("ball", "other"))
    q, _ = jax.jit(
        lambda: moved(model, jc.HuGuo(e=0.3), HERTZ, 1e-3, 0.01, 0.0, 1200, geoms=["ball"])
    )()
    # The ball comes to rest at the depth of its weight; the box stays.
    np.testing.assert_allclose(q[-1, 2], 0.05 - (0.5 * 9.81 / 1e6) ** (2 / 3), atol=REST)
    np.testing.assert_allclose(q[-1, 9], 0.05, atol=1e-3)


ARM = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1" pos="0 0 -.05"/>
    <body>
      <joint type="hinge" axis="0 -1 0"/>
      <inertial pos="0.3 0 0" mass="2" diaginertia="0.01 0.01 0.01"/>
      <geom name="tip" type="sphere" size=".05" pos="0.5 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""


def test_the_effective_mass_of_an_arm():
    """The e of a spring and dashpot depends on its mass: here I/l², not that of the contact."""
    mujoco = pytest.importorskip("mujoco")
    from mujoco import mjx

    model = mujoco.MjModel.from_xml_string(ARM)
    acting = jc.mjx.contact_force(jc.KelvinVoigt(e=0.5), LINEAR, model, substeps=8)
    engine = acting.model.tree_replace({"opt.timestep": 2e-3})
    data = mjx.make_data(acting.model)
    # A tip speed of 1 m/s, 1 mm above the floor.
    data = data.replace(qpos=jnp.array([2e-3]), qvel=jnp.array([-2.0]))
    np.testing.assert_allclose(after(acting, engine, data, 30).qvel, 2 * 0.5, rtol=ERROR)


def test_models_that_cannot_be_followed_are_refused():
    mujoco = pytest.importorskip("mujoco")
    from mujoco import mjx

    law = jc.HuGuo(e=0.5)
    acting = jc.mjx.contact_force(law, HERTZ, made())
    with pytest.raises(ValueError, match="the `model` of this object"):
        acting.init(mjx.put_model(made()), mjx.make_data(acting.model))
    with pytest.raises(ValueError, match="names of geoms"):
        jc.mjx.contact_force(law, HERTZ, made(), geoms=["bal"])
    culled = "<mujoco><custom><numeric name='max_contact_points' data='1'/></custom></mujoco>"
    of_xml, stiff = mujoco.MjModel.from_xml_string, jc.Contact(0.5, jnp.ones(3))
    for words, given in (
        ("plane and box", (law, HERTZ, made(more=OTHER.format(kind="box", x=1, z=1)))),
        ("must be a `MjModel`", (law, HERTZ, 3)),
        ("contact pairs", (law, HERTZ, of_xml("<mujoco/>"))),
        ("max_contact_points", (law, HERTZ, of_xml(culled))),
        (r"`contact.stiffness` .* shape \(3,\)", (law, stiff, made())),
        (r"`law.e` .* each of the 1 pairs", (jc.HuGuo(e=jnp.ones((1, 2)) / 2), HERTZ, made())),
        ("ThorntonPlastic", (jc.ThorntonPlastic(yield_speed=0.1), HERTZ, made())),
    ):
        with pytest.raises(ValueError, match=words):
            jc.mjx.contact_force(*given)

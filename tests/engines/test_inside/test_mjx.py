"""Balls in MJX with the contacts of this package: e, derivatives, several bodies, refusals."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.engines.test_inside import rebound
from tests.engines.test_inside.rebound import ERROR, GRAVITY, HERTZ, LINEAR, after

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
REST = 1e-6  # in m, of the depth at rest: 5e-9 measured


def made(gravity=0.0, more=""):
    mujoco = pytest.importorskip("mujoco")
    pytest.importorskip("mujoco.mjx")
    return mujoco.MjModel.from_xml_string(BALL.format(gravity=gravity, more=more))


def moved(model, law, contact, step, height, velocity, *, steps, **options):
    """The state after the fall of the first body at a speed."""
    from mujoco import mjx

    acting = jc.mjx.contact_force(law, contact, model, **options)
    engine = acting.model.tree_replace({"opt.timestep": step})
    data = mjx.make_data(acting.model)
    data = data.replace(qpos=data.qpos.at[2].add(height), qvel=data.qvel.at[2].set(-velocity))
    return after(acting, engine, data, steps)


def ends(gravity, steps):
    """What `rebound` asks of a fall."""
    model = made(gravity)

    def end(*given):
        data = moved(model, *given, steps=steps)
        return data.qpos[2] - 0.05, data.qvel[2]

    return end


@pytest.mark.parametrize(
    ("law", "numbers"), [(jc.HuGuo, {"e": (0.8, 0.5)}), (jc.ConstantDamping, {"c": (1e5, 4e5)})]
)
def test_a_ball_has_the_restitution_of_its_law(law, numbers):
    ((name, values),) = numbers.items()
    rebound.require_restitution(ends(0.0, 40), [law(**{name: x}) for x in values])


def test_derivatives_of_the_rebound_height():
    rebound.require_derivatives(ends(-GRAVITY, 200), 0.1)


def test_mujoco_keeps_the_other_geoms():
    model = made(gravity=-9.81, more=OTHER.format(kind="box", x=1, z=0.05))
    acting = jc.mjx.contact_force(jc.HuGuo(e=0.3), HERTZ, model, geoms=["ball"])
    assert acting.pairs == (("floor", "ball"), ("ball", "other"))
    law = jc.HuGuo(e=0.3)
    q = moved(model, law, HERTZ, 1e-3, 0.01, 0.0, steps=1200, geoms=["ball"]).qpos
    # The ball comes to rest at the depth of its weight; the box stays.
    np.testing.assert_allclose(q[2], 0.05 - (0.5 * 9.81 / 1e6) ** (2 / 3), atol=REST)
    np.testing.assert_allclose(q[9], 0.05, atol=1e-3)


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

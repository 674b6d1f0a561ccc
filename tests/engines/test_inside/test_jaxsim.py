"""Bodies in JaxSim with the contacts of this package: e, derivatives, joints, refusals."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxcontact as jc
from tests.engines.test_inside import rebound
from tests.engines.test_inside.rebound import ERROR, GRAVITY, HERTZ, LINEAR, after

pytestmark = pytest.mark.engines

# The first and last of the points of a sphere are on the axis y of its collision.
BALL = """
<sdf version="1.9"><model name="ball"><link name="body">
  <inertial><mass>0.5</mass><inertia><ixx>5e-4</ixx><ixy>0</ixy><ixz>0</ixz><iyy>5e-4</iyy>
    <iyz>0</iyz><izz>5e-4</izz></inertia></inertial>
  <collision name="shape"><pose>0 0 0 1.5707963267948966 0 0</pose>
    <geometry><sphere><radius>0.05</radius></sphere></geometry></collision>
</link></model></sdf>
"""

TURNED = 1e-3
"""Of height, velocity and turning after an impact: 4e-4 measured, and half with half the step."""


@pytest.fixture(autouse=True)
def users_promotion(usual_promotion):
    pytest.importorskip("jaxsim")


def made(text, points=None, **options):
    """A model of which these points are enabled, or all."""
    import jaxsim.api as js

    options["integrator"] = js.model.IntegratorType[options.pop("integrator", "SemiImplicitEuler")]
    model = js.model.JaxSimModel.build_from_model_description(text, is_urdf=False, **options)
    if points is not None:
        with model.editable(validate=False) as model:
            found = model.kin_dyn_parameters.contact_parameters
            found.enabled = tuple(k in points for k in range(len(found.body)))
    return model


def at_height(model, height, velocity):
    import jaxsim.api as js

    up = jnp.array([0.0, 0.0, 1.0])
    return js.data.JaxSimModelData.build(
        model, base_position=(0.05 + height) * up, base_linear_velocity=-velocity * up
    )


def ends(gravity, steps):
    """What `rebound` asks of a fall."""
    model = made(BALL, points=[49], gravity=gravity)

    def end(law, contact, step, height, velocity):
        acting = jc.jaxsim.contact_force(law, contact, model)
        engine = dataclasses.replace(acting.model, time_step=step)
        data = after(acting, engine, at_height(engine, height, velocity), steps)
        return data.base_position[2] - 0.05, data.base_velocity[2]

    return end


def test_a_ball_has_the_restitution_of_its_law():
    rebound.require_restitution(ends(0.0, 40), [jc.ExactRestitution(e=e) for e in (0.8, 0.5)])


def test_derivatives_of_the_rebound_height():
    rebound.require_derivatives(ends(GRAVITY, 120), 0.05)


def test_a_body_that_turns_about_a_point_off_its_centre():
    """Beside SciPy. Velocities are in the frame of the body."""
    import jaxsim
    import jaxsim.api as js

    model = made(BALL, points=[49], gravity=0.0, integrator="RungeKutta4")
    law = jc.HuGuo(e=0.5)
    acting = jc.jaxsim.contact_force(law, HERTZ, model)
    tilt, turning, fall, step = 0.5, 20.0, 1.0, 1e-4
    engine = dataclasses.replace(acting.model, time_step=step)
    height = 0.05 * np.cos(tilt) + 1e-3
    data = js.data.JaxSimModelData.build(
        engine,
        base_position=jnp.array([2.0, 0, height]),
        base_quaternion=jnp.array([np.cos(tilt / 2), 0, np.sin(tilt / 2), 0]),
        base_linear_velocity=jnp.array([0.0, 0, -fall]),
        base_angular_velocity=jnp.array([0.0, turning, 0]),
    )
    data = dataclasses.replace(data, velocity_representation=jaxsim.VelRepr.Body)
    end = after(acting, engine, data, 150)
    assert end.velocity_representation is jaxsim.VelRepr.Body
    end = dataclasses.replace(end, velocity_representation=jaxsim.VelRepr.Mixed)

    alpha, v0 = float(law.damping_factor(HERTZ, 1.0)), [1e-9]

    # Height, angle and their rates; the point is 0.05 below the centre, turned by the angle.
    def moves(t, y):
        depth = max(0.05 * np.cos(y[1]) - y[0], 0)
        closing = -y[2] - 0.05 * np.sin(y[1]) * y[3]
        v0[0] = max(v0[0], closing if depth else 0)
        push = 1e6 * depth**1.5 * max(1 + alpha * closing / v0[0], 0)
        return [y[2], y[3], push / 0.5, push * 0.05 * np.sin(y[1]) / 5e-4]

    exact = {"rtol": 1e-10, "atol": 1e-13, "method": "DOP853", "max_step": 1e-5}
    last = solve_ivp(moves, (0, 0.015), [height, tilt, -fall, turning], **exact)
    found = [end.base_position[2], end.base_velocity[2], end.base_velocity[4]]
    np.testing.assert_allclose(found, last.y[[0, 2, 3], -1], rtol=TURNED)


def test_the_force_alone_moves_the_body_as_the_step_does():
    """Beside another force, in the frame of the body."""
    import jaxsim.api as js
    from jaxsim import VelRepr

    acting = jc.jaxsim.contact_force(jc.HuGuo(e=0.5), HERTZ, made(BALL, points=[49]))
    model, pushed = acting.model, jnp.array([[1.0, 2.0, 3.0, 0.1, 0.2, 0.3]])

    @jax.jit
    def both():
        data = dataclasses.replace(
            at_height(model, -0.012, 1.0), velocity_representation=VelRepr.Body
        )
        data = data.replace(model, base_quaternion=jnp.array([0.9, 0.1, 0.2, 0.3]))
        carry = acting.init(model, data)
        forces, own = acting(model, data, carry, link_forces=pushed)
        alone = js.model.step(model, data, link_forces=pushed + forces)
        step, other = acting.step(model, data, carry, link_forces=pushed)
        return forces, own, other, alone, step

    forces, own, other, alone, step = both()
    assert jnp.linalg.norm(forces[0, :3]) > 10
    np.testing.assert_array_equal(own, other)
    speeds = [dataclasses.replace(x, velocity_representation=VelRepr.Mixed) for x in (alone, step)]
    np.testing.assert_allclose(speeds[1].base_velocity, speeds[0].base_velocity, atol=1e-10)


ARMS = """
<sdf version="1.9"><model name="arms">
  <link name="stand"><inertial><mass>1</mass><inertia><ixx>1</ixx><ixy>0</ixy><ixz>0</ixz>
    <iyy>1</iyy><iyz>0</iyz><izz>1</izz></inertia></inertial></link>
  <joint name="fixed" type="fixed"><parent>world</parent><child>stand</child></joint>
  {arms}
</model></sdf>
"""
ARM = """
  <link name="{name}"><pose>0 {y} 0 0 0 0</pose>
    <inertial><pose>0.3 0 0 0 0 0</pose><mass>2</mass><inertia><ixx>0.01</ixx><ixy>0</ixy>
      <ixz>0</ixz><iyy>0.01</iyy><iyz>0</iyz><izz>0.01</izz></inertia></inertial>
    <collision name="{name}"><pose>0.5 0 0 1.5707963267948966 0 0</pose>
      <geometry><sphere><radius>0.05</radius></sphere></geometry></collision></link>
  <joint name="hinge of {name}" type="revolute"><parent>stand</parent><child>{name}</child>
    <axis><xyz>0 -1 0</xyz><limit><lower>-1</lower><upper>1</upper></limit></axis></joint>
"""


def test_the_effective_mass_of_an_arm_beside_one_of_jaxsim():
    """The e of a spring and dashpot depends on its mass: here I/l², not that of the contact."""
    import jaxsim.api as js
    from jaxsim.rbda.contacts import SoftContactsParams
    from jaxsim.terrain import FlatTerrain

    text = ARMS.format(arms="".join(ARM.format(name=n, y=y) for n, y in (("ours", 0), ("soft", 1))))
    model = made(
        text, points=[49, 99], gravity=0.0, terrain=FlatTerrain.build(-0.05),
        contact_params=SoftContactsParams.build(K=1e6, D=1e3, mu=0.0),
    )  # fmt: skip
    law = jc.KelvinVoigt(e=0.5)
    acting = jc.jaxsim.contact_force(law, LINEAR, model, links=["ours"], substeps=8)
    assert acting.points == ("ours",)
    engine = dataclasses.replace(acting.model, time_step=1e-3)
    # Tip speeds of 1 m/s, 1 mm above the floor.
    data = js.data.JaxSimModelData.build(
        engine, joint_positions=jnp.full(2, 2e-3), joint_velocities=jnp.full(2, -2.0)
    )
    ours, soft = after(acting, engine, data, 60).joint_velocities
    np.testing.assert_allclose(ours, 2 * 0.5, rtol=ERROR)
    assert 0.1 < soft < 1.9


def test_models_that_cannot_be_followed_are_refused():
    law = jc.HuGuo(e=0.5)
    model = made(BALL)
    acting = jc.jaxsim.contact_force(law, HERTZ, model)
    assert acting.points == ("body",) * 50
    with pytest.raises(ValueError, match="the `model` of this object"):
        acting.init(model, at_height(model, 0.0, 0.0))
    with pytest.raises(ValueError, match="names of links"):
        jc.jaxsim.contact_force(law, HERTZ, model, links=["foot"])
    stiff = jc.Contact(0.5, jnp.ones((2, 2)))
    for words, given in (
        ("must be a `JaxSimModel`", (law, HERTZ, 3)),
        ("collidable points", (law, HERTZ, acting.model)),
        ("RungeKutta4Fast", (law, HERTZ, made(BALL, integrator="RungeKutta4Fast"))),
        (r"`contact.stiffness` .* points .* shape \(2, 2\)", (law, stiff, model)),
        ("ThorntonPlastic", (jc.ThorntonPlastic(yield_speed=0.1), HERTZ, model)),
    ):
        with pytest.raises(ValueError, match=words):
            jc.jaxsim.contact_force(*given)

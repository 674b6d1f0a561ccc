"""A MuJoCo model of the double pendulum is the one of equations by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc

pytestmark = pytest.mark.engines

MODEL = """
<mujoco>
  <option gravity="0 0 -9.81"/>
  <worldbody>
    <body>
      <joint type="hinge" axis="0 -1 0"/>
      <inertial pos="0 0 -1" mass="1" diaginertia="1e-12 1e-12 1e-12"/>
      <site name="first" pos="0 0 -1"/>
      <body pos="0 0 -1">
        <joint type="hinge" axis="0 -1 0"/>
        <inertial pos="0 0 -1" mass="1" diaginertia="1e-12 1e-12 1e-12"/>
        <site name="second" pos="0 0 -1"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""

AGREE = 1e-8  # of contacts by both: the masses of the model have a radius of inertia of 1e-6 m
FORCES = 2e-7
"""Of the largest forces, read between steps: 3.5e-8 from those of a solve with rtol=1e-13."""


def test_double_pendulum_of_mujoco():
    mujoco = pytest.importorskip("mujoco")
    pytest.importorskip("mujoco.mjx")
    model = mujoco.MjModel.from_xml_string(MODEL)
    system, _ = jc.systems.from_mjx(
        model, lambda t, sites, args: sites[:, 0] + 0.3, law=jc.HuGuo(e=0.7), stiffness=1e7
    )
    # Joint angles are relative to the parent.
    start = {"position": jnp.array([1.0, 0.5]), "velocity": jnp.zeros(2)}
    run = jc.simulate(system, 2.5, **start, v0="touch", rtol=1e-11)
    ours, by_hand = jc.systems.double_pendulum()
    expected = jc.simulate(ours, 2.5, **by_hand, v0="touch", rtol=1e-11)
    got, table = run.contacts.to_dict(), expected.contacts.to_dict()
    np.testing.assert_array_equal(got["gap"], table["gap"])
    for name in ("time", "closing_speed", "restitution"):
        np.testing.assert_allclose(got[name], table[name], rtol=AGREE, err_msg=name)
    np.testing.assert_allclose(got["max_force"], table["max_force"], rtol=FORCES)

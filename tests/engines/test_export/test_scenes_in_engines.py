"""Exported scenes in the real engines move as `simulate` says, or as far off as their export says.

A separate group like test_engines.py: `pytest -m engines`.
"""

import jax
import numpy as np
import pytest

import jaxcontact as jc
from benchmarks.engines import scene_agreement as study
from benchmarks.engines.scene_agreement import RUBBER, TIMES, TOLERANCE
from tests.engines.test_export.run import needed, run_scene
from tests.oracle.stored import stored

pytestmark = pytest.mark.engines


# Of a few impacts at up to 1 m/s, and the flights between them, in m/s and in m.
SPEED, PLACE = 1e-2, 2e-3


@stored()
def own_run(make, words, numbers):
    """What is compared of the run of `simulate`: the scene by its name, its words and numbers."""
    engine, function = next(case for case in study.CASES if case[1].__name__ == make)
    return study.of_simulate(engine, function)[0]


@pytest.mark.slow(
    "drake-falls_on_a_line",
    "drake-rubs_in_drake",
    reason="a minute of Drake's small steps; two scenes and the oblique impacts below are in Drake",
)
@pytest.mark.parametrize(("engine", "make"), study.CASES)
def test_the_engine_moves_as_simulate_says(engine, make, tmp_path):
    needed(engine)
    scene = make()
    numbers = [np.ravel(leaf) for leaf in jax.tree.leaves(scene)]
    found = study.agreement(engine, make, tmp_path, own_run(make.__name__, repr(scene), numbers))
    assert found["expected_error"] <= TOLERANCE * (1 + 1e-6)
    assert found["impacts"] > 0
    assert found["velocity"] < SPEED and found["place"] < PLACE
    assert found.get("spin", 0) < SPEED
    # Relative to the energy, twice the error of the speeds.
    assert found["energy"] < 2 * SPEED
    # The same impacts in the same order, none moved as far as to its rival.
    assert found["time"] <= TIMES[1] and found["time"] < found["margin"]


def test_lammps_gives_the_same_on_two_ranks(tmp_path):
    needed("lammps")
    # Two ranks on shared cores wait for each other, so that few steps are taken.
    made = jc.export_scene(study.in_a_box(), "lammps", TIMES[-1], tolerance=0.1)
    (tmp_path / "two").mkdir()
    (tmp_path / "one").mkdir()
    one, two = run_scene(made, tmp_path / "one"), run_scene(made, tmp_path / "two", ranks=2)
    # Ranks add the forces in another order.
    np.testing.assert_allclose(two.position, one.position, rtol=0, atol=1e-9)


def test_mujoco_misses_a_tolerance_as_stated(tmp_path):
    needed("mujoco")
    made, errors = study.of_a_robot(tmp_path)
    assert not made.keeps_tolerance
    # The stated error is that of the worst position of the touch within a step.
    assert 0.5 * made.expected_error < np.abs(errors).max() < 1.02 * made.expected_error


def test_drake_misses_a_law_as_stated(tmp_path):
    """Its e falls with speed, where that of the law is constant."""
    needed("drake")
    made, errors = study.of_a_constant(tmp_path)
    assert not made.keeps_tolerance
    # Too large at the smallest speed, too small at the largest: the least that both can have.
    assert errors[0] > 0 > errors[1]
    assert 0.7 * made.expected_error < np.max(np.abs(errors)) < made.expected_error


def test_lammps_rubs_as_an_oblique_impact_of_its_own_law_does(tmp_path):
    needed("lammps")
    friction, radius = jc.SpringSlider(0.3, form="displacement"), 0.02
    ball = jc.Sphere(radius, position=[0.0, 0.021], velocity=[1.0, -0.8], spin=3.0, material=RUBBER)
    plane = jc.Plane([0.0, 0.0], [0.0, 1.0])
    scene = jc.Scene([ball, plane], law=jc.HuGuo(e=0.8), friction=friction)
    made = jc.export_scene(scene, "lammps", 0.01, velocity=(0.8, 0.8))
    run = run_scene(made, tmp_path)
    contact = jc.Contact.sphere_plane(radius, RUBBER)
    law = made.contacts[0].law
    own = jc.oblique_impact(law, contact, 0.8, 1.0 + radius * 3.0, friction=friction)
    slip = run.velocity[-1, 0, 0] + radius * run.spin[-1, 0]
    # Measured 0.0065: in LAMMPS the tangential spring follows the overlap of the step before.
    assert slip == pytest.approx(float(own.slip_velocity), abs=0.015)
    other = jc.oblique_impact(jc.HuGuo(e=0.8), contact, 0.8, 1.0 + radius * 3.0, friction=friction)
    assert abs(slip - float(other.slip_velocity)) > 0.03


# Of hard contacts, in m/s: the error of e, and the turn of the normal while two spheres slide.
REBOUND = 1e-2


@pytest.mark.parametrize("engine", ["mujoco", "drake", "lammps"])
@pytest.mark.parametrize("name", study.OBLIQUE)
def test_rigid_coulomb_slides_or_sticks_as_in_simulate(engine, name, tmp_path):
    needed(engine)
    found = study.rebound(engine, name, tmp_path, study.HARDER)
    # Measured 0.002 along the normal, 0.0023 across it and 0.0057 in the spin.
    assert max(found["normal"], found["slip"], found["spin"]) < REBOUND
    if "stick" in name:
        assert max(found["slip"], found["spin"]) < REBOUND / 50


def test_mujocos_soft_friction_is_not_enough(tmp_path):
    """Without `noslip` the friction pushes along the normal, too."""
    needed("mujoco")
    assert study.of_soft_friction(tmp_path) < -0.5

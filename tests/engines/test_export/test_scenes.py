"""Whole scenes as models of engines: numbers and refusals.

The engines themselves run in test_scenes_in_engines.py.
"""

import io
import math
import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact.engines.scenes.engine import scene_engines
from tests.engines.test_export import two_balls
from tests.engines.test_export.two_balls import BALLS, FRICTION, LAW, TABLE, TIMES, rolling, scene


def exported(made_of, engine, **words):
    given = {"times": TIMES, "velocity": two_balls.SPEEDS, "tolerance": 0.01}
    return jc.export_scene(made_of, engine, TIMES[-1], **{**given, **words})


@pytest.fixture(scope="module")
def lammps():
    return jc.export_scene(scene(), "lammps", TIMES[-1], times=TIMES, velocity=two_balls.SPEEDS)


def test_lammps_has_the_stiffness_of_each_pair(lammps):
    text = lammps.files["scene.in"]
    e = float(jc.restitution(LAW))
    found = dict(re.findall(r"pair_coeff (\d \d) hertz (\S+ \S+) tangential", text))
    k_n, delivered = map(float, found["1 2"].split())
    # K = k_n √R with the effective radius.
    assert k_n == pytest.approx(two_balls.STIFFNESS / math.sqrt(0.01 * 0.02 / 0.03), rel=1e-10)
    assert delivered == pytest.approx(e, rel=1e-8)
    walls = re.findall(r"wall/gran/region granular hertz (\S+)", text)
    assert sorted(map(float, walls)) == pytest.approx(
        [two_balls.STIFFNESS / math.sqrt(radius) for radius in (0.02, 0.01)], rel=1e-10
    )
    assert "plane 0 0 0 0 1 0 side in" in text and "dimension 2" in text


def test_lammps_has_the_masses_and_velocities(lammps):
    atoms, velocities = lammps.files["scene.data"].split("Atoms # sphere")[1].split("Velocities")
    rows, moves = np.loadtxt(io.StringIO(atoms)), np.loadtxt(io.StringIO(velocities))
    mass = math.pi / 6 * rows[:, 2] ** 3 * rows[:, 3]
    np.testing.assert_allclose(mass, [0.03, 0.1], rtol=1e-12)
    np.testing.assert_allclose(rows[:, 4:6], [[0.0, 0.05], [0.05, 0.06]])
    np.testing.assert_allclose(moves[:, 1:3], [[0.3, 0.0], [0.0, -0.2]])


def test_lammps_counts_whole_periods():
    ball = jc.Sphere(0.01, 0.03, [-0.7, 0.05], [0.3, 0.0])
    text = exported(scene(ball, TABLE, periodic=[0.5, None]), "lammps").files["scene.data"]
    row = text.split("Atoms # sphere")[1].split("Velocities")[0].split()
    assert (float(row[4]), row[7:]) == (pytest.approx(0.3), ["-2", "0", "0"])
    assert "0 0.5 xlo xhi" in text


def test_steps_fit_between_outputs_and_keep_e(lammps):
    assert lammps.keeps_tolerance and lammps.expected_error == pytest.approx(1e-3)
    between = lammps.steps / (len(TIMES) - 1)
    assert between == int(between)
    assert lammps.time_step * between == pytest.approx(TIMES[1])
    # Hertz: T = 2.9432 (5 m/(4 K))^(2/5) v^(-1/5) at e = 1; damping adds some.
    mass = 0.03 * 0.1 / 0.13
    hertz = 2.9432 * (1.25 * mass / two_balls.STIFFNESS) ** 0.4 * two_balls.SPEEDS[1] ** -0.2
    assert 20 < hertz / lammps.time_step < 1000
    assert "error of e      0.001" in repr(lammps)


def test_one_type_of_any_size_where_size_does_not_count():
    steel = jc.Material(2e11, 0.3, 7800.0)
    spheres = [jc.Sphere(0.01 + 1e-5 * k, None, [0.1 * k, 0.1], material=steel) for k in range(99)]
    friction = jc.SpringSlider(0.3)
    made = exported(scene(*spheres, TABLE, stiffness=None, friction=friction), "lammps")
    text = made.files["scene.in"]
    assert "99 atoms\n1 atom types" in made.files["scene.data"]
    modulus = 2e11 / (2 * 0.91)
    k_n, k_t, mu = re.search(
        r"pair_coeff 1 1 hertz (\S+) \S+ tangential mindlin/force (\S+) 0 (\S+)", text
    ).groups()
    assert float(k_n) == pytest.approx(4 / 3 * modulus, rel=1e-9)
    # Mindlin: 8 G* with G* = G/(2(2-ν)).
    assert float(k_t) == pytest.approx(8 * 2e11 / 2.6 / (2 * 1.7), rel=1e-9)
    assert float(mu) == 0.3


def test_lammps_moves_walls_and_bodies():
    shaken = jc.Plane([0.0, 0.0], [0.0, 1.0], motion=jc.Vibration(0.01, 10.0, 0.5))
    pusher = jc.Sphere(0.01, position=[0.3, 0.1], fixed=True, motion=jc.Steady([0.5, 0.0]))
    text = exported(scene(*BALLS, shaken, pusher), "lammps").files["scene.in"]
    assert re.search(r"region wall0_body_2 plane .* side in units box move v_wall0_body_2_x", text)
    (shift,) = re.findall(r'variable wall0_body_2_y equal "(.*)"', text)
    time = 0.0123
    value = eval(shift, {"sin": math.sin, "time": time})
    expected = 0.01 * (math.sin(2 * math.pi * 10 * time + 0.5) - math.sin(0.5))
    assert value == pytest.approx(expected, rel=1e-12)
    for words in ("fix frozen fixed freeze", "fix body_3 body_3 move variable v_body_3_x"):
        assert words in text


def test_mujoco_says_which_friction_it_holds():
    with pytest.raises(ValueError, match="coefficients of friction of") as told:
        exported(rolling(friction=jc.RigidCoulomb(1e-6)), "mujoco")
    held = float(re.search(r"of ([\d.e-]+) or more", str(told.value))[1])
    exported(rolling(friction=jc.RigidCoulomb(held)), "mujoco")
    with pytest.raises(ValueError, match="coefficients of friction of"):
        exported(rolling(friction=jc.RigidCoulomb(0.95 * held)), "mujoco")


def test_mujoco_has_the_friction_of_each_pair():
    made = exported(rolling(friction=two_balls.BY_PAIR), "mujoco")
    xml = ElementTree.fromstring(made.files["scene.xml"])
    found = {(p.get("geom1"), p.get("geom2")): p for p in xml.iter("pair")}
    assert set(found) == {("wall0", "sphere0"), ("wall0", "sphere1"), ("sphere0", "sphere1")}
    assert found["wall0", "sphere0"].get("friction") == "0.1 0.1"
    assert found["sphere0", "sphere1"].get("friction") == "0.4 0.4"
    for pair in found.values():
        _, damping = map(float, pair.get("solreffriction").split())
        # A slip may stop within one step; MuJoCo divides by the impedance.
        assert -damping * made.time_step == pytest.approx(0.9) and pair.get("condim") == "3"
    option = xml.find("option")
    # The soft friction vanishes, so that it does not change e; `noslip` finds that of μF.
    assert float(option.get("impratio")) < 1e-6 and int(option.get("noslip_iterations")) > 0
    masses = [float(x.get("mass")) for x in xml.iter("inertial")]
    # The determinant of `noslip`, μ⁴/m², has to be above 1e-10.
    assert masses[0] / masses[1] == pytest.approx(0.3) and 0.1**4 / max(masses) ** 2 > 1e-9
    # Free joints: place and quaternion, velocity and spin.
    (key,) = xml.iter("key")
    assert key.get("qvel").split()[:6] == ["0.29999999999999999", "0", "0", "0", "0", "3"]
    made = exported(rolling(friction=jc.RigidCoulomb(0.0)), "mujoco")
    compile(made.files["run.py"], "run.py", "exec")
    smooth = made.files["scene.xml"]
    assert smooth.count('condim="1"') == 3 and "units of" not in smooth


def test_drake_has_the_masses_friction_and_spins():
    law, friction = jc.MarhefkaOrin(a=0.1), jc.RigidCoulomb(0.3)
    rubs = rolling(law=law, exponent=1.0, stiffness=1e4, friction=friction)
    made = exported(rubs, "drake", tolerance=0.01, velocity=(1.0, 1.0))
    world = ElementTree.fromstring(made.files["scene.sdf"])
    masses = [float(mass.text) for mass in world.iter("mass")]
    assert masses == [0.03, 0.1] and len(list(world.iter("model"))) == 3
    assert made.files["scene.sdf"].count("<drake:mu_dynamic>0.3</drake:mu_dynamic>") == 3
    found = constants(made)
    np.testing.assert_array_equal(found["SPIN"], [[0, 0, 3], [0, 0, 0]])
    # Far below the speeds of the scene, 1 m/s.
    assert 0 < found["STICKS"] <= 1e-4


def test_a_robots_step_states_its_error():
    ball = jc.Sphere(0.1, 1.0, [0.2], [-1.0])
    law, stiffness = jc.KelvinVoigt(e=0.6, tension=False), 85667.0
    of_robot = jc.Scene([ball, jc.Plane([0.0], [1.0])], law=law, stiffness=stiffness, exponent=1.0)
    found = jc.export_scene(
        of_robot, "mujoco", 0.2, times=[0.0, 0.1, 0.2], time_step=0.002, velocity=(1.0, 1.0)
    )
    # docs/export.md: e from 0.548 to 0.695 at this step.
    assert not found.keeps_tolerance
    assert found.expected_error == pytest.approx(0.095, abs=1e-3)
    assert "above the tolerance 0.001" in repr(found)
    assert len(list(ElementTree.fromstring(found.files["scene.xml"]).iter("pair"))) == 1


SHELL = jc.Shell([0.0, 0.0], 1.0)
MOVING = jc.Plane([0.0, 0.0], [0.0, 1.0], motion=jc.Steady([0.0, 0.1]))
OWN = jc.Plane([0.0, 0.0], [0.0, 1.0], motion=jc.Prescribed(lambda t, args: 0.01 * t, 1.0))
RIGID, DMT = jc.RigidCoulomb(0.3), jc.DMT(pull_off=1e-3)
POWDER = jc.Luding(ratio=2.0, slope=10.0, adhesion=0.1)
HOLLOW = jc.Sphere(0.01, 0.03, [0.0, 0.05], inertia=1e-5)
SIZES = [jc.Sphere(0.01 + 1e-5 * k, 0.1, [0.1 * k, 0.1]) for k in range(60)]
LIGHT, TOUCHING = jc.Sphere(0.01, 1e-8, [0.0, 0.05]), jc.Sphere(0.01, 0.03, [0.0, 0.01])
LAWS = {("ball", "the table"): LAW, "default": jc.HuGuo(e=0.5)}
REFUSED = {
    "lammps": [
        ({"friction": jc.WaltonFriction(0.3, 0.4)}, "Walton.*, which has no force over time"),
        ({"friction": jc.RegularizedCoulomb(0.3, 0.1)}, "whose ramp follows the normal force"),
        ({"friction": jc.MawBarberFawcett(0.3, 0.8)}, "for LAMMPS.* sticks and slips in parts"),
        (
            {"law": jc.ExactRestitution(e=0.1), "friction": RIGID},
            "above 0.1353 for LAMMPS.* which `RigidCoulomb` needs, .*; try in a scene a `SpringSl",
        ),
        ({"bodies": [HOLLOW, TABLE], "friction": FRICTION}, "`inertia` of solid spheres"),
        ({"bodies": [*SIZES, TABLE]}, "at most 40 kinds"),
        ({"bodies": [*BALLS, OWN]}, "`Steady` or `Vibration`"),
        ({"friction": jc.SpringSlider(0.3)}, "`ratio` of `SpringSlider` must be given"),
        ({"stiffness": None}, "a `stiffness`, or a material"),
        ({"law": jc.JKR(pull_off=1e-3)}, "without adhesion"),
        ({"law": DMT, "friction": RIGID}, "`friction=None` beside adhesion"),
    ],
    "mujoco": [
        ({"law": DMT}, "`DMT` can be exported"),
        ({"bodies": [*BALLS, SHELL]}, "Shell"),
        ({"bodies": BALLS, "periodic": [1.0, None]}, "`periodic=None`"),
        ({"bodies": [*BALLS, MOVING]}, "moves"),
        ({"friction": FRICTION}, "law `RigidCoulomb` for MuJ"),
        (
            {"bodies": [LIGHT, BALLS[1]], "friction": jc.RigidCoulomb(0.01)},
            "or 0, for MuJoCo with these masses, speeds and durations of contact, but has 0.01",
        ),
    ],
    "exudyn": [
        ({"law": POWDER, "exponent": 1.0}, "a `Luding` of slope 0"),
        ({"friction": RIGID}, "RegularizedC"),
        ({"bodies": [TOUCHING, TABLE]}, "start apart"),
    ],
    "drake": [
        ({"law": LAWS}, "one `law`"),
        ({"friction": FRICTION}, "law `RigidCoulomb` for Drake"),
        ({"friction": two_balls.BY_PAIR}, "one `friction` for Drake"),
    ],
}


ROWS = [(engine, *row) for engine, rows in REFUSED.items() for row in rows]


@pytest.mark.parametrize(("engine", "words", "message"), ROWS)
def test_what_an_engine_cannot_express_is_named(engine, words, message):
    given = dict(words)
    with pytest.raises(ValueError, match=message):
        exported(scene(*given.pop("bodies", ()), **given), engine)


def test_arguments_are_named():
    for engine, words, message in (
        ("yade", {}, r"`engine` must be one of .*'lammps'"),
        ("lammps", {"times": [0.0, 0.05, 0.06]}, "`times` must be evenly spaced"),
        ("lammps", {"times": [0.0, 0.2]}, "`times` must lie between"),
        ("lammps", {"time_step": 0.03}, "`time_step` must be a whole fraction"),
        ("lammps", {"velocity": (0.0, 1.0)}, "`velocity`"),
        ("exudyn", {"time_step": 0.01}, r"`time_step` must be at most .*'exudyn'"),
    ):
        with pytest.raises(ValueError, match=message):
            exported(scene(), engine, **words)
    assert list(scene_engines()) == ["drake", "exudyn", "lammps", "mujoco"]


def test_speeds_follow_from_the_scene():
    bare = jc.Scene([*BALLS, TABLE], law=LAW, stiffness=two_balls.STIFFNESS)
    assert exported(bare, "lammps", velocity=None).velocity[1] >= 0.2
    spheres = [jc.Sphere(0.01, 0.03, [0.1 * k, 0.5]) for k in range(9)]
    many = exported(scene(*spheres, TABLE), "lammps", velocity=None)
    # In the duration they fall for 0.1 s, and no farther than to the table.
    assert many.velocity[1] == pytest.approx(two_balls.GRAVITY * 0.1)


def constants(made):
    """The constants of a script, which can be compiled."""
    compile(made.files["run.py"], "run.py", "exec")
    lines = [x for x in made.files["run.py"].splitlines() if re.match("[A-Z]+ = ", x)]
    found = {"numpy": np}
    exec("\n".join(lines), found)
    return found


def test_exudyn_has_plastic_contacts_and_a_large_sphere_in_place_of_a_wall():
    law = jc.Luding(ratio=2.0, slope=0.0, adhesion=0.2)
    found = constants(exported(scene(law=law, exponent=1.0, stiffness=1e5), "exudyn"))
    (*_, contact), *_ = found["PAIRS"]
    assert contact["contactPlasticityRatio"] == 0.5 and contact["adhesionCoefficient"] == 2e4
    assert found["WALLS"] == [] and len(found["ROUND"]) == 2
    for k, centre, radius, hollow, gap, wall in found["ROUND"]:
        assert not hollow and wall["impactModel"] == 0
        # The top of the sphere is the wall; a gap rounds to 1e-10 of the scene.
        height = found["PLACE"][k][1] - found["RADIUS"][k]
        assert centre[1] + radius == pytest.approx(0, abs=1e-10)
        assert gap == pytest.approx(height, abs=1e-12)


def test_plastic_contacts_that_exudyn_has_not_have_a_matched_e():
    law = jc.WaltonBraun(ratio=2.0, slope=10.0)
    made = exported(scene(law=law, exponent=1.0, stiffness=1e5), "exudyn", tolerance=0.1)
    e = {contact.parameters["restitutionCoefficient"] for contact in made.contacts}
    assert all(0 < value < 1 for value in e)
    assert constants(made)["PAIRS"] and "contactPlasticityRatio" not in made.files["run.py"]


def test_lammps_stops_a_slip_in_one_step():
    """Coulomb friction: the multiple of the damping that is the longest without overshoot."""
    ball, mu = jc.Sphere(0.01, 0.03, [0.0, 0.05]), 0.3
    for e in (0.6, 1.0):
        words = {"law": jc.ExactRestitution(e=e), "friction": jc.RigidCoulomb(mu)}
        made = exported(scene(ball, TABLE, gravity=None, **words), "lammps")
        pattern = r"hertz (\S+) (\S+) tangential linear_nohistory (\S+) (\S+) damping (.*) region"
        *numbers, damping = re.search(pattern, made.files["scene.in"]).groups()
        k_n, nominal, multiple, written = map(float, numbers)
        assert (damping, written) == ("coeff_restitution limit_damping", mu)
        # Without the pull at its end a contact delivers more than LAMMPS' e.
        clamped = jc.AntypovElliott(e=nominal, tension=False)
        assert float(jc.restitution(clamped)) == pytest.approx(e, abs=1e-5)
        contact = jc.Contact(0.03, k_n * 0.01**0.5)
        depth = float(jc.impact(clamped, contact, two_balls.SPEEDS[1]).max_indentation)
        log = math.log(nominal)
        eta = -math.sqrt(5) * log / math.hypot(math.pi, log) * math.sqrt(0.03 * k_n)
        eta *= (0.01 * depth) ** 0.25
        slowed = 3.5 * multiple * eta * made.time_step / 0.03
        assert slowed == pytest.approx(1, rel=1e-3)


def test_lammps_has_the_adhesion_of_each_pair():
    made = exported(scene(law=jc.DMT(pull_off=0.2), stiffness=1e7), "lammps", tolerance=0.01)
    text = made.files["scene.in"]
    found = re.findall(r"(?:pair_coeff (\d \d)|granular) dmt (\S+) 0 (\S+) (\S+) tangential", text)
    radii = [0.01 * 0.02 / 0.03, 0.01, 0.02]
    named = [x for x in found if x[0] in ("1 2", "")]
    assert len(named) == 3 and "damping" not in text
    for (_, young, nu, gamma), radius in zip(named, radii, strict=True):
        modulus = float(young) / (2 * (1 - float(nu) ** 2))
        assert 4 / 3 * modulus * math.sqrt(radius) == pytest.approx(1e7, rel=1e-9)
        assert 4 * math.pi * float(gamma) * radius == pytest.approx(0.2, rel=1e-9)


def test_steps_get_what_the_law_leaves_of_the_tolerance():
    ball, table = jc.Sphere(0.01, 0.03, [0.1]), jc.Plane([0.0], [1.0])
    falling = jc.Scene([ball, table], jc.Bridges(0.9, 0.01, 0.3), stiffness=1e6, gravity=[-9.81])
    made = exported(falling, "lammps", tolerance=0.05)
    assert made.keeps_tolerance and made.expected_error == pytest.approx(0.05)


def test_steps_keep_e_at_the_slowest_speed_too():
    """The e of Drake's law is larger there, and so is its error by steps of one length."""
    ball, wall = jc.Sphere(0.01, 0.03, [0.0115, 0.0], [-1.0, 0.0]), jc.Plane([0.0, 0.0], [1.0, 0.0])
    words = {"law": jc.MarhefkaOrin(a=0.15), "stiffness": 1e5, "exponent": 1.0}
    made = [
        jc.export_scene(jc.Scene([ball, wall], **words), "drake", 0.006, velocity=v, tolerance=5e-3)
        for v in ((0.6, 6.0), (6.0, 6.1))
    ]
    assert all(one.keeps_tolerance for one in made)
    assert made[0].time_step < 0.5 * made[1].time_step


def test_friction_widens_the_closing_speeds():
    """A belt or a spin may throw a ball at another body."""
    slow = exported(scene(), "lammps", velocity=None).velocity
    still = exported(scene(friction=FRICTION), "lammps", velocity=None).velocity
    assert still[1] >= slow[1]
    belt = jc.Plane([0.0, 0.0], [0.0, 1.0], motion=jc.Steady([20.0, 0.0]))
    fast = exported(scene(*BALLS, belt, friction=FRICTION), "lammps", velocity=None).velocity
    assert fast[1] > 20

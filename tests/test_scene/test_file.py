"""Scenes in files: equal to scenes built in Python; errors state place and reason."""

import re

import jax
import numpy as np
import pytest

import jaxcontact as jc

GOOD = """
duration = 1.0
times = 3
instantaneous = true
gravity = [0.0, -9.81]
periodic = [2.0, false]
stiffness = 1e6
law = { name = "hu_guo", e = 0.7 }

[material.steel]
youngs_modulus = 2.1e11
poisson_ratio = 0.3
density = 7800

[[plane]]
name = "table"
point = [0.0, 0.0]
normal = [0.0, 1.0]
motion = { kind = "vibration", amplitude = 0.01, frequency = 5, phase = 0.5 }

[[sphere]]
name = "ball"
radius = 0.1
position = [0.5, 0.5]
velocity = [1.0, 0.0]
material = "steel"

[[random_spheres]]
count = 2
low = [0.0, 1.0]
high = [2.0, 2.0]
radius = 0.1
mass = 1.0
speed = 1.0
periodic = [2.0, false]

[[pair]]
bodies = ["ball", "table"]
law = "hertz"
stiffness = 1e5
"""


@pytest.fixture
def read(tmp_path):
    def read(text):
        (tmp_path / "my.toml").write_text(text)
        return jc.read_scene(tmp_path / "my.toml")

    return read


def test_a_file_makes_the_scene_that_python_makes(read):
    scene, how = read(GOOD)
    steel = jc.Material(2.1e11, 0.3, 7800)
    shaken = jc.Vibration(amplitude=0.01, frequency=5, phase=0.5)
    box = {"low": [0.0, 1.0], "high": [2.0, 2.0]}
    bodies = [
        jc.Plane([0.0, 0.0], [0.0, 1.0], name="table", motion=shaken),
        jc.Sphere(0.1, None, [0.5, 0.5], [1.0, 0.0], material=steel, name="ball"),
        *jc.random_spheres(2, **box, radius=0.1, mass=1.0, speed=1.0, periodic=(2.0, None)),
    ]
    same = jc.Scene(
        bodies, {("ball", "table"): jc.Hertz(), "default": jc.HuGuo(e=0.7)},
        stiffness={("ball", "table"): 1e5, "default": 1e6}, gravity=[0.0, -9.81],
        periodic=(2.0, None),
    )  # fmt: skip
    assert jax.tree.structure(scene) == jax.tree.structure(same)
    for one, other in zip(jax.tree.leaves(scene), jax.tree.leaves(same), strict=True):
        np.testing.assert_array_equal(one, other)
    assert list(how.pop("times")) == [0.0, 0.5, 1.0]
    assert how == {"duration": 1.0, "instantaneous": True}


def test_times_may_be_listed_or_left_out(read):
    assert read(GOOD.replace("times = 3", "times = [0.1, 0.7]"))[1]["times"] == [0.1, 0.7]
    times = read(GOOD.replace("times = 3", ""))[1]["times"]
    assert len(times) == 201 and times[-1] == 1.0


@pytest.mark.parametrize(("name", "spheres"), [("line", 6), ("table", 1), ("box", 30)])
def test_examples(name, spheres):
    scene, how = jc.read_scene(example=name)
    assert len(scene.spheres) == spheres
    assert how["duration"] == how["times"][-1]


def test_the_shaking_table():
    scene, how = jc.read_scene(example="table")
    run = jc.simulate(scene, **how)
    assert run.status == jc.Ending.COMPLETED and len(run.impacts) > 5
    np.testing.assert_allclose(
        run.energy[-1], run.energy[0] + run.wall_work - np.sum(run.impacts.energy_loss), rtol=1e-12
    )


A_BALL = "radius = 0.1\nposition"
PAIR = 'bodies = ["ball", "table"]'
FAULTS = {
    "no TOML": ("duration = ", "duration == ", "my.toml must be TOML, but is not: "),
    "a key": ("duration", "duratoin", "at the top: a key or table must be one of duration, "),
    "a hint": ("stiffness", "stifness", "but is 'stifness'; did you mean 'stiffness'?"),
    "who watches": ("times = 3", "progress = true", "but is 'progress'"),
    "a sphere's key": (
        A_BALL,
        "raduis = 0.1\nposition",
        "[[sphere]] number 1: a key must be one of radius, mass, position, velocity, material, "
        "name, fixed, motion, spin, inertia, but is 'raduis'; did you mean 'radius'?",
    ),
    "not modelled": (
        A_BALL,
        "radius = 0.1\nrolling = 3.0\nposition",
        "inertia, but is 'rolling': friction is `friction=` of a `Scene`, a `System` or "
        "`oblique_impact`, such as `RigidCoulomb(mu=0.3)`.",
    ),
    "missing": (
        "normal = [0.0, 1.0]", "",
        "[[plane]] number 1: the key 'normal' must be given, but is missing.",
    ),
    "a value": (
        A_BALL, "radius = -0.1\nposition",
        "[[sphere]] number 1: Argument `radius` must be in (0, inf), but is -0.1.",
    ),
    "no table": ("[[sphere]]", "[sphere]", "'sphere' must be tables [[sphere]], but is {"),
    "a law": ("hu_guo", "hu_gou", "[law]: 'name' of the law must be one of hertz, "),
    "a law's hint": ("hu_guo", "hu_gou", "but is 'hu_gou'; did you mean 'hu_guo'?"),
    "a parameter": (
        "e = 0.7", "f = 0.7", "[law]: a parameter of hu_guo must be one of e, but is 'f'.",
    ),
    "its value": ("e = 0.7", "e = 1.7", "[law]: Argument `e` must be in (0, 1], but is 1.7."),
    "no parameter": (
        ", e = 0.7 }", " }",
        "[law]: the law hu_guo must have its parameter 'e', but it is missing.",
    ),
    "no law": (
        'law = { name = "hu_guo", e = 0.7 }', "",
        "at the top: Argument `law` must have an entry for 'table' and an unnamed body",
    ),
    "a material": (
        '"steel"', '"stel"',
        "[[sphere]] number 1: 'material' must be one of steel, but is 'stel'; did you mean 'steel'",
    ),
    "its key": (
        "poisson_ratio", "poisson", "[material.steel]: a key must be one of youngs_modulus",
    ),
    "a motion": (
        '"vibration"', '"shaking"',
        "[[plane]] number 1: 'kind' of the motion must be one of steady, vibration, but is 'shak",
    ),
    "its number": (
        "frequency = 5", "frequency = 0",
        "[[plane]] number 1, motion: Argument `frequency` must be in (0, inf), but is 0.",
    ),
    "a pair": (
        PAIR, 'bodies = ["ball"]',
        "[[pair]] number 1: 'bodies' must be two names, but is ['ball'].",
    ),
    "its bodies": (
        PAIR, 'bodies = ["ball", "tabel"]',
        "`law` must name bodies of the scene ('table', 'ball'), but names 'tabel'",
    ),
    "no duration": ("duration = 1.0", "", "the key 'duration' must be given, but is missing."),
    "duration": ("duration = 1.0", "duration = -1", "`duration` must be a number in (0, inf)"),
    "times": ("times = 3", "times = 1", "`times` must be a whole number of at least 2"),
    "periodic": (
        "periodic = [2.0, false]\nstiff", "periodic = 2.0\nstiff",
        "'periodic' must be a list with a length in m, or false, for each axis, but is 2.0.",
    ),
    "overlap": (
        "position = [0.5, 0.5]", "position = [0.5, 0.05]",
        "at the top: Argument `bodies` must not overlap at the start, but Sphere 'ball'",
    ),
    "random": (
        "count = 2", "count = 200",
        "[[random_spheres]] number 1: Argument `count` must be one that fits into the box",
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_bad_files(read, fault):
    old, new, words = FAULTS[fault]
    assert GOOD.count(old) >= 1
    with pytest.raises(ValueError, match=re.escape(words)) as error:
        read(GOOD.replace(old, new, 1))
    assert "my.toml" in str(error.value)


def test_bad_arguments(tmp_path):
    with pytest.raises(ValueError, match="`file` must be the path"):
        jc.read_scene("x.toml", example="line")
    with pytest.raises(OSError, match=r"none\.toml"):
        jc.read_scene(tmp_path / "none.toml")
    (tmp_path / "latin.toml").write_bytes("title = 'ü'".encode("latin-1"))
    with pytest.raises(ValueError, match=r"latin\.toml must be a text in UTF-8"):
        jc.read_scene(tmp_path / "latin.toml")


def test_a_shell_and_its_ball(tmp_path):
    file = tmp_path / "bowl.toml"
    file.write_text(
        """
        duration = 1.0
        law = { name = "exact", e = 0.5 }
        sphere = [{ radius = 0.1, mass = 1.0, position = [0.0, 0.0] }]

        [[shell]]
        centre = [0.0, 0.0]
        radius = 1.0
        name = "bowl"
        motion = { kind = "vibration", amplitude = [0.02, 0.0], frequency = 5.0 }
        """
    )
    scene, _ = jc.read_scene(file)
    bowl = scene.bodies[1]
    assert isinstance(bowl, jc.Shell) and bowl.name == "bowl"
    shakes = jc.Vibration([0.02, 0.0], 5.0)
    assert all(map(np.array_equal, jax.tree.leaves(bowl.motion), jax.tree.leaves(shakes)))

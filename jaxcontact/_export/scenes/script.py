"""The parts that Python scripts of several engines share: numbers, and the table they write."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .engine import EqualSteps
from .model import SceneModel

_RECORD = '''
class Table:
    """Collect states and write them with the columns of `Run.to_csv`."""

    def __init__(self):
        self.rows = []

    def add(self, time, position, velocity, spin=None):
        """Add a state; rows of N spheres, of which the first axes are written."""
        x = numpy.reshape(position, (len(MASS), -1))[:, :AXES]
        v = numpy.reshape(velocity, (len(MASS), -1))[:, :AXES]
        free = numpy.isfinite(MASS)
        energy = (numpy.sum(v**2, axis=1) / 2 - x @ GRAVITY)[free] @ MASS[free]
        row = [time, energy, *x.ravel(), *v.ravel()]
        if SPINS:
            w = numpy.reshape(spin, (len(MASS), -1))
            row[1] += numpy.sum(w**2, axis=1)[free] @ INERTIA[free] / 2
            row += [*w.ravel()]
        self.rows.append(row)

    def write(self, file="run.csv"):
        """Write the table."""
        places = [f"[{k},{d}]" for k in range(len(MASS)) for d in range(AXES)]
        heads = ["time", "energy", *("position" + p for p in places)]
        heads += ["velocity" + p for p in places]
        if SPINS:
            turns = range(3) if AXES == 3 else [None]
            for k in range(len(MASS)):
                heads += [f"spin[{k}]" if d is None else f"spin[{k},{d}]" for d in turns]
        with open(file, "w", newline="") as out:
            writer = csv.writer(out, lineterminator="\\n")
            writer.writerow(heads)
            writer.writerows([[repr(float(x)) for x in row] for row in self.rows])
'''


def script(
    title: str,
    imports: Sequence[str],
    numbers: dict[str, Any],
    body: str,
    model: SceneModel,
    steps: EqualSteps,
) -> str:
    """Return a script: imports, numbers in SI units as constants, `Table`, and the body.

    Arrays become NumPy arrays. Every script has `STEP` in s, `BETWEEN`, `OUTPUTS` and those of
    `Table`.
    """
    own = {
        "STEP": steps.length,
        "BETWEEN": steps.between,
        "OUTPUTS": steps.outputs,
        "AXES": model.dimensions,
        "SPINS": model.scene.friction is not None,
        "GRAVITY": model.gravity[: model.dimensions],
        "MASS": model.mass,
        "INERTIA": model.inertia,
        **numbers,
    }
    lines = [f'"""{title}"""', "", "import csv", "", "import numpy", *imports, ""]
    lines += [f"{name} = {_literal(value)}" for name, value in own.items()]
    return "\n".join(lines) + "\n\n" + _RECORD + "\n\n" + body.strip() + "\n"


def _literal(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"numpy.array({_literal(value.tolist())})".replace("inf", "numpy.inf")
    return repr(value)

"""The core works without the laboratory: with its folder deleted everything else imports."""

import shutil
import subprocess
import sys
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "jaxcontact"

_ASKED = """
import importlib, pkgutil
import jaxcontact as jc

assert importlib.util.find_spec("jaxcontact._lab") is None
commands = "jaxcontact._cli", "jaxcontact.__main__"
for module in pkgutil.walk_packages(jc.__path__, "jaxcontact."):
    if not module.name.startswith(commands):
        importlib.import_module(module.name)
for name in jc.__all__:
    try:
        getattr(jc, name)
    except ModuleNotFoundError:
        print(name)
"""


def test_without_the_laboratory_everything_else_imports(tmp_path):
    copy = tmp_path / "jaxcontact"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("_lab", "__pycache__"))
    done = subprocess.run(
        [sys.executable, "-c", _ASKED], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == sorted(
        "Calibration CalibrationSummary FrictionCalibration LowPass Recording RecordingError "
        "calibrate calibrate_friction fit_record load_calibration read_recording report".split()
    )

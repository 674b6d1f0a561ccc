"""Names that were public at the last release still exist and take the same arguments."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import jaxcontact
from tests.public_names import names, written


def faults(before: dict[str, list[str]], now: dict[str, list[str]]) -> list[str]:
    """What someone who used `before` would trip over."""
    found = [f"{name} is gone" for name in before.keys() - now.keys()]
    for name in before.keys() & now.keys():
        old, new = before[name], now[name]
        lost = [one for one in old if one not in new and one != "*"]
        found += [f"{name} no longer takes {one}" for one in lost]
        positional = old[: old.index("*")] if "*" in old else old
        if not lost and new[: len(positional)] != positional:
            found.append(f"{name} takes {', '.join(new)} and took {', '.join(old)}")
    return sorted(found)


def test_nothing_public_went_unannounced():
    """Where something must go: say so in CHANGELOG.md, then run `python -m tests.public_names`."""
    assert faults(written(), names()) == []


@pytest.mark.parametrize(
    ("now", "told"),
    [
        ({}, "f is gone"),
        ({"f": ["a", "c", "*", "d"]}, "f no longer takes b"),
        ({"f": ["b", "a", "*", "d"]}, "f takes b, a, *, d and took a, b, *, d"),
        ({"f": ["a", "new", "b", "*", "d"]}, "f takes a, new, b, *, d and took a, b, *, d"),
    ],
)
def test_what_breaks_is_told(now, told):
    before = {"f": ["a", "b", "*", "d"]}
    assert faults(before, now) == [told]
    assert faults(before, {"f": ["a", "b", "later", "*", "new", "d"], "g": []}) == []


PACKAGE = Path(__file__).parents[2] / "jaxcontact"

_ASKED = """
import importlib, pkgutil
import jaxcontact as jc

assert importlib.util.find_spec("jaxcontact.lab") is None
commands = "jaxcontact.lab.cli", "jaxcontact.__main__"
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
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("lab", "__pycache__"))
    done = subprocess.run(
        [sys.executable, "-c", _ASKED], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == sorted(
        name for name, room in jaxcontact._HOME.items() if room.startswith("lab")
    )

"""Names that were public at the last release still exist and take the same arguments. All are
listed, and loaded on first use.
"""

import ast
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


ROOT = Path(jaxcontact.__file__).parent


def test_names_load_on_first_use():
    """Each with its room and what that needs, pictures with theirs, and all of them where they are
    listed. One process, in this order.
    """
    code = """
import sys, jaxcontact as jc, jaxcontact.lab.cli
assert not {"jax", "numpy", "matplotlib"} & set(sys.modules), "--help would wait"
assert not hasattr(jc, "nonsense")
loaded = lambda: {name.split(".")[1] for name in sys.modules if name.startswith("jaxcontact.")}
jc.HuGuo, jc.Contact, jc.impact, jc.fit
late = {"_scene", "_system", "_sweep", "_inverse", "engines", "_bounce", "plot", "systems"}
assert not loaded() & late and "jaxcontact.lab.calibration" not in sys.modules, loaded()
heavy = "diffrax matplotlib optax optimistix pandas scipy tqdm xarray".split()
assert not set(heavy) & set(sys.modules), "an impact would wait"
import jax
assert not jax.config.jax_enable_x64
assert jc.plot is sys.modules["jaxcontact.plot"] and callable(jc.plot.trajectory)
assert jc.plot.fit.__module__.startswith("jaxcontact.plot") and callable(jc.paper.fig6)
names = {}
exec("from jaxcontact import *", names)
assert set(jc.__all__) <= set(names) and set(jc.__all__) <= set(dir(jc))
"""
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT.parent)


def imported_names(path: Path, body: list[ast.stmt]) -> dict[str, str]:
    """Return the names that are imported as themselves, each with its room. A star stands for all
    that the room itself imports so.
    """
    found: dict[str, str] = {}
    for node in body:
        for alias in node.names if isinstance(node, ast.ImportFrom) else ():
            if alias.name == "*":
                room = path.parent / node.module / "__init__.py"
                of_room = imported_names(room, ast.parse(room.read_text()).body)
                found |= dict.fromkeys(of_room, node.module)
            elif alias.asname == alias.name:
                found[alias.name] = node.module
    return found


def test_names_are_listed_where_they_live():
    """The list that checkers read and the one that is used are the same."""
    path = ROOT / "__init__.py"
    (block,) = [node for node in ast.parse(path.read_text()).body if isinstance(node, ast.If)]
    assert imported_names(path, block.body) == jaxcontact._HOME

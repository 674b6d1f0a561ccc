"""Imports go one way: a room imports only lower rooms, and files form no cycle.

Heavy libraries are imported only in the functions that use them. The source is parsed, not run, so
an import inside a function counts too. An import under ``if TYPE_CHECKING`` never runs. It counts
for a cycle within one room. Across rooms it lets a lower room annotate an object of a higher one (a
law its contact), and does not count.
"""

import ast
import enum
import functools
import graphlib
import textwrap
from collections.abc import Iterator
from pathlib import Path

from jaxcontact import AbstractForm, AbstractLaw

PACKAGE = "jaxcontact"
ROOT = Path(__file__).parents[2] / PACKAGE

# From the ground up. A room may import rooms on lower floors, and on its own floor only itself.
FLOORS = [
    {"_entry"},
    {"_cache", "_fast_loops", "_functions", "_program", "_text", "data"},
    {"_flight", "_fit", "_solver"},
    {"_forms"},
    {"_laws", "_friction"},
    {"_contact"},
    {"_impact", "_coupled"},
    {"_bounce", "_scene", "_sweep"},
    {"_inverse", "_system"},
    {"_simulate", "systems"},
    {"plot"},
    {"__init__", "extend"},
    {"engines", "paper"},
    {"jaxsim", "lab", "mjx"},
    {"__main__"},
]
PARTS = {"engines", "lab", "paper"}
"""They take public names and those of `extend` from the core, which stands below, nothing else."""
PUBLIC = {"__init__", "extend", "plot", "systems"}
FLOOR = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}

# Where a library may be imported at all, and where during the loading of a module; None is
# everywhere.
ALLOWED: dict[str, tuple[set[str] | None, set[str] | None]] = {
    "diffrax": (set(FLOOR) - {"_forms", "_laws", "_contact", *FLOORS[0], *FLOORS[1]}, None),
    "optimistix": (set(FLOOR) - {"_forms", "_laws", "_contact", *FLOORS[0], *FLOORS[1]}, None),
    "matplotlib": ({"plot", "paper", "lab"}, {"plot"}), "soundfile": ({"lab"}, set()),
    "optax": ({"_fit"}, set()), "blackjax": ({"_fit"}, set()), "arviz_stats": ({"_fit"}, set()),
    "xarray": (None, set()), "zarr": (None, set()), "tqdm": ({"_text"}, set()),
    "jaxsim": ({"engines"}, set()), "mujoco": ({"engines"}, set()), "tests": (set(), set()),
    "benchmarks": (set(), set()),
}  # fmt: skip


class When(enum.Enum):
    """When a part of a module runs: at its load, in a call, or never, under TYPE_CHECKING."""

    LOAD = enum.auto()
    CALL = enum.auto()
    NEVER = enum.auto()


def _walk(node: ast.AST, when: When = When.LOAD) -> Iterator[tuple[ast.AST, When]]:
    """All nodes, each with when it runs."""
    yield node, when
    for name, value in ast.iter_fields(node):
        inside = when
        if name == "body" and isinstance(node, ast.If):
            checking = _dotted(node.test).split(".")[-1].lstrip("_") == "TYPE_CHECKING"
            inside = When.NEVER if checking else when
        deferred = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        if name == "body" and deferred and when is When.LOAD:
            inside = When.CALL
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _walk(child, inside)


def _imports(node: ast.AST, package: list[str]) -> list[str]:
    """The absolute names of the modules that a node imports."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if not isinstance(node, ast.ImportFrom):
        return []
    base = package[: len(package) - node.level + 1] if node.level else []
    stem = [*base, *([node.module] if node.module else [])]
    # `from . import _laws` names a room, `from ._laws import Hertz` does not. The longer name
    # covers both.
    return [".".join([*stem, alias.name]) for alias in node.names]


def _dotted(node: ast.AST) -> str:
    if isinstance(node, ast.Attribute):
        return f"{_dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def violations(root: Path) -> list[str]:
    """Every breach of the arrows in a package tree, as lines that say where and what."""
    found = []
    for path in sorted(root.rglob("*.py")):
        parts = path.relative_to(root).parts
        room = parts[0].removesuffix(".py")
        where = "/".join(parts)
        commands = parts[:2] == ("lab", "cli")
        if room not in FLOOR:
            found.append(f"{where}: room {room} has no floor")
            continue
        for node, when in _walk(ast.parse(path.read_text())):
            complaints = [] if when is When.NEVER else _uses(node, room, when, commands)
            for name in _imports(node, [PACKAGE, *parts[:-1]]):
                complaints += _inside(room, name)
                complaints += [] if when is When.NEVER else _complaints(room, name, when, commands)
            found += [f"{where}:{node.lineno}: {complaint}" for complaint in complaints]
    return found


def _uses(node: ast.AST, room: str, when: When, commands: bool) -> list[str]:
    """What is wrong with an attribute that is read or called."""
    name = _dotted(node) if isinstance(node, ast.Attribute) else ""
    if name == "jax._src":
        return ["uses jax._src"]
    if commands or not name.startswith("jax.config."):
        return []
    if when is When.LOAD:
        return ["touches jax.config while loading"]
    # Requested explicitly by `jc.cache()`.
    return ["sets jax.config"] if name == "jax.config.update" and room != "_cache" else []


def _inside(room: str, name: str) -> list[str]:
    """What a part of the package takes from the core that is not public."""
    top, _, rest = name.partition(".")
    target = rest.split(".")[0]
    target = target if target in FLOOR else "__init__"
    private = any(word.startswith("_") for word in rest.split("."))
    if room not in PARTS or top != PACKAGE or target == room:
        return []
    public = target in PUBLIC | PARTS and not private
    return [] if public else [f"{room} takes {rest} from inside of the core"]


def _complaints(room: str, name: str, when: When, commands: bool) -> list[str]:
    """What is wrong with an import that runs."""
    top, _, rest = name.partition(".")
    # Everything that is not a room is a name of the package itself.
    target = rest.split(".")[0] if rest.split(".")[0] in FLOOR else "__init__"
    anywhere, at_load = ALLOWED.get(top, (None, None))
    if name.startswith("jax._src"):
        return ["imports jax._src"]
    if name.startswith("jax.config") and when is When.LOAD and not commands:
        return ["imports jax.config"]
    if top == PACKAGE and target != room and FLOOR[target] >= FLOOR[room]:
        return [f"{room} may not import {target}"]
    if anywhere is not None and room not in anywhere:
        return [f"{room} may not import {top}"]
    if when is When.LOAD and at_load is not None and room not in at_load:
        return [f"{room} may import {top} only inside functions"]
    return []


def _file_of(name: str, root: Path) -> str | None:
    """The file of the package that an imported name stands in, relative to `root`."""
    top, *parts = name.split(".")
    # Longest name first: a name that is not a file is a name inside one.
    for end in range(len(parts), -1, -1) if top == PACKAGE else ():
        stem = "/".join(parts[:end])
        for file in (f"{stem}.py", f"{stem}/__init__.py".lstrip("/")):
            if (root / file).is_file():
                return file
    return None


@functools.cache
def _arrows(root: Path) -> dict[str, set[str]]:
    """For every file of a package tree the files that it imports."""
    arrows: dict[str, set[str]] = {}
    for path in sorted(root.rglob("*.py")):
        where = path.relative_to(root)
        targets = arrows.setdefault(where.as_posix(), set())
        for node, when in _walk(ast.parse(path.read_text())):
            for name in _imports(node, [PACKAGE, *where.parts[:-1]]):
                file = _file_of(name, root)
                same = file and file.split("/")[0] == where.parts[0]
                if file and (same or when is not When.NEVER):
                    targets.add(file)
        targets.discard(where.as_posix())
    return arrows


def circle(root: Path) -> set[str]:
    """Files that import each other, directly or through others; empty if none do."""
    try:
        graphlib.TopologicalSorter(_arrows(root)).prepare()
    except graphlib.CycleError as error:
        return set(error.args[1])
    return set()


def test_the_arrows_hold():
    assert violations(ROOT) == []


def test_no_files_import_each_other():
    assert circle(ROOT) == set()


def _tested_types(file: Path) -> set[str]:
    """The names of the classes that isinstance and issubclass calls of a file test for."""
    return {
        _dotted(part).split(".")[-1]
        for call in ast.walk(ast.parse(file.read_text()))
        if isinstance(call, ast.Call) and _dotted(call.func) in ("isinstance", "issubclass")
        for part in ast.walk(call.args[1])
        if isinstance(part, ast.Name | ast.Attribute)
    }


def test_no_room_asks_for_the_type_of_a_law_or_a_form():
    kinds = {cls.__name__ for base in (AbstractLaw, AbstractForm) for cls in _subclasses(base)}
    assert {"HuGuo", "AbstractOscillator", "HuntCrossleyForm"} <= kinds
    for room in ("_impact", "_bounce", "_forms"):
        for file in sorted((ROOT / room).rglob("*.py")):
            assert not _tested_types(file) & kinds, file


def _subclasses(base: type) -> set[type]:
    return {sub for cls in base.__subclasses__() for sub in (cls, *_subclasses(cls))}


def test_the_analysis_of_a_sweep_stands_alone():
    for file, targets in _arrows(ROOT).items():
        if file.startswith("_sweep/skip/"):
            assert all(target.startswith("_sweep/skip/") for target in targets), file


GOOD = {
    "_laws/_base.py": """
        from typing import TYPE_CHECKING
        import jax
        from .._entry import parameter
        from ._registry import register
        if TYPE_CHECKING:
            from .._contact import Contact
        def twice():
            return jax.config.jax_enable_x64
    """,
    "_impact/_solve.py": "import diffrax\nfrom .. import _laws\nfrom .._contact import Contact\n",
    "_fit/_adam.py": "def fit():\n    import optax\n",
    "plot/__init__.py": "import matplotlib.pyplot as plt\nfrom .._impact import impact\n",
    "lab/cli/__init__.py": "import jax\njax.config.update('jax_enable_x64', True)\n",
    "lab/read.py": "from .. import impact\nfrom ..extend import rendered\nfrom ..plot import fit\n",
    "__init__.py": "from ._impact import impact as impact\n",
    "__main__.py": "from .lab.cli import main\nfrom jaxcontact import impact\n",
}

BAD = [
    ("_contact.py", "from ._impact import impact", "_contact may not import _impact"),
    ("_contact.py", "from . import _impact", "_contact may not import _impact"),
    ("_contact.py", "import jaxcontact._impact", "_contact may not import _impact"),
    ("_laws/_a.py", "def f():\n    from .._contact import x", "_laws may not import _contact"),
    ("_laws/_a.py", "import jaxcontact as jc", "_laws may not import __init__"),
    ("_laws/_a.py", "import diffrax", "_laws may not import diffrax"),
    ("_fit/_a.py", "from .._laws import Hertz", "_fit may not import _laws"),
    ("_impact/_a.py", "from matplotlib import pyplot", "_impact may not import matplotlib"),
    ("_fit/_a.py", "import optax", "only inside functions"),
    ("_sweep/_a.py", "def f():\n    import optax", "_sweep may not import optax"),
    ("_sweep/_a.py", "class A:\n    import xarray", "only inside functions"),
    ("_impact/_a.py", "import jax\njax.config.update('a', 1)", "touches jax.config"),
    ("_impact/_a.py", "def f():\n    jax.config.update('a', 1)", "sets jax.config"),
    ("_impact/_a.py", "def f(x=jax.config.jax_enable_x64):\n    pass", "touches jax.config"),
    ("_impact/_a.py", "from jax import config", "imports jax.config"),
    ("_impact/_a.py", "from jax._src import core", "imports jax._src"),
    ("_impact/_a.py", "import jax\njax._src.core", "uses jax._src"),
    ("lab/a.py", "from .._fit import scatter", "from inside of the core"),
    ("engines/a.py", "from ..plot._drawing import x", "from inside of the core"),
    ("paper/_a.py", "if TYPE_CHECKING:\n    from .._laws import Hertz", "from inside of the core"),
    ("engines/a.py", "from ..lab import x", "engines may not import lab"),
    ("_attic.py", "", "has no floor"),
    ("_impact/_a.py", "from tests import oracle", "_impact may not import tests"),
    ("_laws/_a.py", "if TYPE_CHECKING:\n    pass\nelse:\n    from .._impact import x", "_impact"),
]  # fmt: skip


def build(root: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(textwrap.dedent(text))
    return root


def test_a_sound_house_passes_and_breaches_are_seen(tmp_path):
    assert violations(build(tmp_path, GOOD)) == []
    for name, text, complaint in BAD:
        found = violations(build(tmp_path, {name: text}))
        assert len(found) == 1 and complaint in found[0], (name, text, found)
        (tmp_path / name).unlink()


CIRCLES = [
    {"_a": "from ._b import x", "_b": "from . import _a"},
    {"_a": "from ._b import x", "_b": "import jaxcontact._sweep._c", "_c": "from ._a import y"},
    {"_a": "from ._b import x", "_b": "def f():\n    from ._a import y"},
    {"_a": "if TYPE_CHECKING:\n    from ._b import x", "_b": "from ._a import y"},
    {"__init__": "from ._a import y", "_a": "from .._sweep import z"},
    {"_a": "from ._c import x", "_c/__init__": "from ._b import x", "_c/_b": "from .._a import y"},
]
"""Files of one room."""


def test_circles_are_seen(tmp_path):
    for k, files in enumerate(CIRCLES):
        files = {f"_sweep/{name}.py": text for name, text in files.items()}
        root = build(tmp_path / str(k), {**GOOD, "_sweep/_d.py": "from ._a import y", **files})
        assert circle(root) == set(files)
    # A law, in a lower room, annotates the contact.
    above = {"_contact.py": "from ._laws._base import x", "_laws/_registry.py": "x = 1"}
    assert circle(build(tmp_path / "good", GOOD | above)) == set()

"""Fingerprint of the code that answered a job."""

from __future__ import annotations

import ast
import functools
import hashlib
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "jaxcontact"
# Everything that an impact depends on; rooms above impacts do not affect the map.
ROOMS = (
    *("_parameter.py", "_varying.py", "_elementary.py", "_implicit.py", "_contact.py"),
    *("_program", "_solver", "_forms", "_laws", "_impact"),
)


@functools.cache
def fingerprint() -> str:
    """Ten digits that change with the code that computes impacts, but not with words about it."""
    digest = hashlib.sha256()
    for room in ROOMS:
        place = PACKAGE / room
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            name = path.relative_to(PACKAGE).as_posix()
            digest.update(f"{name}\n{without_words(path.read_text())}\n".encode())
    return digest.hexdigest()[:10]


def without_words(source: str) -> str:
    """The code without comments, docstrings and the way it is set."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            node.body = [one for one in node.body if not _is_text(one)] or [ast.Pass()]
    return ast.unparse(tree)


def _is_text(node: ast.stmt) -> bool:
    """Test whether a statement is a string alone: a docstring, also one below a constant."""
    if not isinstance(node, ast.Expr) or not isinstance(node.value, ast.Constant):
        return False
    return isinstance(node.value.value, str)

"""Fingerprint of the code that answered a job."""

from __future__ import annotations

import ast
import functools
import hashlib
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).resolve().parents[2] / "jaxcontact"
# Everything that an impact depends on; rooms above impacts do not affect the map.
ROOMS = (
    *("_entry", "_functions", "_program", "_contact.py"),
    *("_solver", "_forms", "_laws", "_impact"),
)


@functools.cache
def fingerprint() -> str:
    """Ten digits that change with the code that computes impacts, but neither with words about it
    nor with the file that a definition stands in.
    """
    found = []
    for room in ROOMS:
        place = PACKAGE / room
        for path in place.rglob("*.py") if place.is_dir() else [place]:
            statements = _without_texts(ast.parse(path.read_text())).body
            found += [repr(_plain(each)) for each in statements if not _is_import(each)]
    return hashlib.sha256("\n".join(sorted(found)).encode()).hexdigest()[:10]


def without_words(source: str) -> str:
    """The code without comments, docstrings and the way it is set."""
    return repr(_plain(_without_texts(ast.parse(source))))


def _without_texts(tree: ast.Module) -> ast.Module:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            node.body = [each for each in node.body if not _is_text(each)] or [ast.Pass()]
    return tree


def _plain(node: Any) -> Any:
    """A tree as nested tuples of what is set, the same in every version of Python.

    `ast.unparse` quotes f-strings by the version that runs it.
    """
    if isinstance(node, list):
        return tuple(map(_plain, node))
    if not isinstance(node, ast.AST):
        return node
    fields = ((name, _plain(part)) for name, part in ast.iter_fields(node))
    return (type(node).__name__, *(field for field in fields if field[1] not in (None, ())))


def _is_text(node: ast.stmt) -> bool:
    """Test whether a statement is a string alone: a docstring, also one below a constant."""
    if not isinstance(node, ast.Expr) or not isinstance(node.value, ast.Constant):
        return False
    return isinstance(node.value.value, str)


def _is_import(node: ast.stmt) -> bool:
    """Test for an import, a list of public names, or a file of words only."""
    if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
        return node.targets[0].id == "__all__"
    return isinstance(node, ast.Import | ast.ImportFrom | ast.Pass)

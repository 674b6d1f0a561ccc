"""Faults of five kinds in a source: find them, plant them, and draw them by seed."""

import ast
import copy
import random
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeGuard

KINDS = ("sign", "constant", "condition", "swapped argument", "dropped check")

_OPPOSITES = (
    (ast.Add, ast.Sub),
    (ast.And, ast.Or),
    (ast.Lt, ast.GtE),
    (ast.Gt, ast.LtE),
    (ast.Eq, ast.NotEq),
    (ast.Is, ast.IsNot),
    (ast.In, ast.NotIn),
)
_OPPOSITE: dict[type, type] = {a: b for pair in _OPPOSITES for a, b in (pair, pair[::-1])}
# Numbers that set the look of a figure or the line of a warning; a test would only repeat them.
_LOOKS = set(
    "bbox_to_anchor dpi figsize fontsize linewidth lw markersize ncols stacklevel zorder".split()
)
_COMMUTES = set(
    "add multiply maximum minimum max min hypot logical_and logical_or logical_xor equal not_equal "
    "isclose allclose array_equal broadcast_arrays broadcast_shapes result_type promote_types "
    "gcd union intersection print".split()
)
_SEQUENCE = ast.Constant | ast.JoinedStr | ast.List | ast.Tuple | ast.ListComp
SCOPE = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


@dataclass(frozen=True)
class Fault:
    """One change of one expression: its characters from `start` to `end` become `text`."""

    path: str
    line: int
    scope: str
    kind: str
    old: str
    new: str
    start: int
    end: int
    text: str

    @property
    def room(self) -> str:
        return room_of(self.path)

    @property
    def change(self) -> str:
        return f"{self.path}, {self.scope or 'module'}: {self.old} → {self.new}"

    @property
    def key(self) -> str:
        return f"{self.path}:{self.line}:{self.start} {self.kind}: {self.old} → {self.new}"


def room_of(path: str) -> str:
    """The room that a file of the package belongs to: its folder, or itself."""
    return Path(path).parts[1].removesuffix(".py")


def _is_number(node: ast.AST) -> TypeGuard[ast.Constant]:
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def _other_number(x: Any) -> float:
    """One more or a tenth of a whole number; of others a tenth off, a thousandfold if tiny or huge.

    Of a tolerance or a limit only the order matters.
    """
    if isinstance(x, int):
        return x + 1 if abs(x) < 16 else x // 10
    if x == 0:
        return 1.0
    factor = 1.1 if 1e-3 < abs(x) < 1e3 else 1e3 if abs(x) <= 1e-3 else 1e-3
    return float(f"{x * factor:.12g}")


def _called(node: ast.Call) -> str:
    return node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")


def _changed(node: ast.expr, **fields: object) -> ast.expr:
    new = copy.copy(node)
    for name, value in fields.items():
        setattr(new, name, value)
    return new


def _faults_at(node: ast.AST) -> Iterator[tuple[str, ast.expr, ast.expr]]:
    """The kind, the expression and what it becomes, of each fault that a node allows."""
    match node:
        case ast.BinOp(left=a, op=ast.Add() | ast.Sub(), right=b) if not (
            (isinstance(a, _SEQUENCE) and not _is_number(a))
            or (isinstance(b, _SEQUENCE) and not _is_number(b))
        ):
            yield "sign", node, _changed(node, op=_OPPOSITE[type(node.op)]())
        case ast.UnaryOp(op=ast.USub()):
            yield "sign", node, _changed(node, op=ast.UAdd())
        case ast.Constant() if _is_number(node):
            yield "constant", node, ast.Constant(_other_number(node.value))
        case ast.Compare():
            for i, op in enumerate(node.ops):
                ops = [*node.ops[:i], _OPPOSITE[type(op)](), *node.ops[i + 1 :]]
                yield "condition", node, _changed(node, ops=ops)
        case ast.BoolOp():
            yield "condition", node, _changed(node, op=_OPPOSITE[type(node.op)]())
        case ast.If() | ast.IfExp():
            if not (isinstance(node.test, ast.Compare) and len(node.test.ops) == 1):  # done above
                yield "condition", node.test, ast.UnaryOp(ast.Not(), node.test)
            if isinstance(node, ast.If) and isinstance(node.body[-1], ast.Raise):
                yield "dropped check", node.test, ast.Constant(False)
        case ast.Call(args=args) if _called(node) not in _COMMUTES:
            for i, (a, b) in enumerate(pairwise(args)):
                starred = isinstance(a, ast.Starred) or isinstance(b, ast.Starred)
                if not starred and ast.dump(a) != ast.dump(b):
                    swapped = [*args[:i], b, a, *args[i + 2 :]]
                    yield "swapped argument", node, _changed(node, args=swapped)


def _children(node: ast.AST) -> Iterator[ast.AST]:
    """The parts of a node that run, without f-strings: Python 3.11 misplaces what is inside."""
    if isinstance(node, ast.Assert | ast.JoinedStr) or (
        (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test))
        or (isinstance(node, ast.keyword) and node.arg in _LOOKS)
    ):
        return
    for name, value in ast.iter_fields(node):
        if name not in ("annotation", "returns"):
            some = value if isinstance(value, list) else [value]
            yield from (x for x in some if isinstance(x, ast.AST))


def _walk(node: ast.AST, scope: str = "") -> Iterator[tuple[ast.AST, str]]:
    children = list(_children(node))
    if children or not isinstance(node, ast.If):
        yield node, scope
    inner = f"{scope}.{node.name}".lstrip(".") if isinstance(node, SCOPE) else scope
    for child in children:
        yield from _walk(child, inner)


def faults(path: str, source: str) -> list[Fault]:
    """All faults that can be planted in a file, in the order of the source."""
    lines = source.splitlines(keepends=True)
    begins = [0]
    for line in lines:
        begins.append(begins[-1] + len(line))

    def at(line: int, column: int) -> int:  # ast counts bytes
        return begins[line - 1] + len(lines[line - 1].encode()[:column].decode())

    found = []
    for node, scope in _walk(ast.parse(source)):
        for kind, expression, new in _faults_at(node):
            start = at(expression.lineno, expression.col_offset)
            end = at(expression.end_lineno or 0, expression.end_col_offset or 0)
            # The lines below keep their numbers.
            text = f"({ast.unparse(new)}{chr(10) * source[start:end].count(chr(10))})"
            old, told = ast.unparse(expression), ast.unparse(new)
            found.append(Fault(path, expression.lineno, scope, kind, old, told, start, end, text))
    return sorted(found, key=lambda x: (x.start, x.end, x.kind, x.new))


def plant(source: str, fault: Fault) -> str:
    """The source with a fault in it."""
    return source[: fault.start] + fault.text + source[fault.end :]


def sample(sources: dict[str, str], count: int, seed: int) -> list[Fault]:
    """Faults over all rooms: two a room, the others by the rooms' lines; all kinds as often.

    No two are in the same expression.
    """

    def places(some: list[Fault]) -> int:
        return len({(x.path, x.start, x.end) for x in some})

    chance = random.Random(seed)
    pool, size = defaultdict(list), Counter()
    for path in sorted(sources):
        if found := faults(path, sources[path]):
            pool[room_of(path)] += found
            size[room_of(path)] += sources[path].count("\n")
    share = {room: min(2, places(pool[room])) for room in pool}
    while sum(share.values()) < count:
        free = [room for room in pool if share[room] < places(pool[room])]
        share[max(free, key=lambda room: size[room] / share[room])] += 1
    drawn, used = [], Counter()
    for room in chance.sample(sorted(pool), len(pool)):
        for _ in range(share[room]):
            kinds = [kind for kind in KINDS if any(x.kind == kind for x in pool[room])]
            kind = min(chance.sample(kinds, len(kinds)), key=lambda x: used[x])
            fault = chance.choice([x for x in pool[room] if x.kind == kind])
            same = fault.path, fault.start, fault.end
            pool[room] = [x for x in pool[room] if (x.path, x.start, x.end) != same]
            used[fault.kind] += 1
            drawn.append(fault)
    return drawn

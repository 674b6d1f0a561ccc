"""The size of the house: `python .ci/house.py` counts it, beside the count that is committed.

Lines and files of the package, the largest folder and function, how branched functions are
(McCabe's complexity), class names that stand for several things, and `isinstance`. It fails where a
number is above its limit. `--write` keeps this count as the last one.
"""

from __future__ import annotations

import ast
import collections
import json
import sys
from pathlib import Path

HERE = Path(__file__).parent
PACKAGE = HERE.parent / "jaxcontact"
LAST = HERE / "house.json"

LIMITS = {
    "lines": 68_500,
    "files in one folder": 14,
    "lines of the longest function": 120,
    "largest complexity": 25,
    "functions above complexity 10, per 1000": 45.5,
    "class names with several meanings": 0,
    "isinstance per 1000 lines": 7.2,
}
"""No number may be above these. They go down as the house gets better."""

_BRANCHES = (ast.If, ast.IfExp, ast.For, ast.While, ast.ExceptHandler, ast.Assert)


def complexity(function: ast.AST) -> int:
    """Paths through a function: one, and one more for each branch, without nested functions."""
    count, rest = 1, list(ast.iter_child_nodes(function))
    while rest:
        node = rest.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            continue
        count += isinstance(node, _BRANCHES)
        if isinstance(node, ast.BoolOp):
            count += len(node.values) - 1
        if isinstance(node, ast.comprehension):
            count += 1 + len(node.ifs)
        rest += ast.iter_child_nodes(node)
    return count


def counted() -> tuple[dict[str, float], dict[str, str]]:
    """The numbers, and where the largest of them stand."""
    lines, calls, functions = 0, 0, []
    classes: collections.Counter[str] = collections.Counter()
    folders: collections.Counter[Path] = collections.Counter()
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text()
        lines += text.count("\n")
        folders[path.parent] += 1
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                name = f"{path.relative_to(PACKAGE.parent)}:{node.lineno} {node.name}"
                functions.append((name, node.end_lineno - node.lineno + 1, complexity(node)))
            elif isinstance(node, ast.ClassDef):
                classes[node.name] += 1
            elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "isinstance":
                calls += 1
    folder, most = folders.most_common(1)[0]
    longest = max(functions, key=lambda one: one[1])
    branched = max(functions, key=lambda one: one[2])
    several = sorted(name for name, count in classes.items() if count > 1)
    numbers = {
        "lines": lines,
        "files": sum(folders.values()),
        "files in one folder": most,
        "lines of the longest function": longest[1],
        "largest complexity": branched[2],
        "functions above complexity 10, per 1000": round(
            1000 * sum(one[2] > 10 for one in functions) / len(functions), 1
        ),
        "class names with several meanings": len(several),
        "isinstance per 1000 lines": round(1000 * calls / lines, 2),
    }
    where = {
        "files in one folder": str(folder.relative_to(PACKAGE.parent)),
        "lines of the longest function": longest[0],
        "largest complexity": branched[0],
        "class names with several meanings": " ".join(several),
    }
    return numbers, where


def main() -> int:
    numbers, where = counted()
    last = json.loads(LAST.read_text()) if LAST.exists() else {}
    print(f"{'':42}{'now':>8}{'last':>8}{'limit':>8}")
    for name, value in numbers.items():
        limit = LIMITS.get(name, "")
        print(f"{name:42}{value:>8}{last.get(name, ''):>8}{limit:>8}  {where.get(name, '')}")
    if "--write" in sys.argv[1:]:
        LAST.write_text(json.dumps(numbers, indent=1) + "\n")
    over = [name for name, limit in LIMITS.items() if numbers[name] > limit]
    if over:
        print("above the limit:", ", ".join(over))
    return bool(over)


if __name__ == "__main__":
    sys.exit(main())

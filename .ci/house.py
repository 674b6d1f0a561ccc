"""The size of the house beside its limits: `python .ci/house.py`.

It counts lines of each part of the package, of tests and of benchmarks; the longest function and
folder; how branched functions are (McCabe's complexity); `isinstance`; small files; class names
that stand for several things or differ by an underscore alone. It fails where a number is above
its limit in `.ci/limits.json`. `--lower` brings limits down to this count; none is ever raised. A
file named as an argument holds further ceilings of lines, by folder.
"""

from __future__ import annotations

import ast
import collections
import json
import sys
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent
PACKAGE = ROOT / "jaxcontact"
LIMITS = HERE / "limits.json"
PARTS = ("lab", "engines", "paper")
SMALL = 60
"""Lines below which a file is small."""

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


def lines_of(folder: Path) -> int:
    return sum(path.read_text("utf-8").count("\n") for path in folder.rglob("*.py"))


def counted() -> tuple[dict[str, float], dict[str, str]]:
    """The numbers, and where the largest of them stand."""
    lines: collections.Counter[str] = collections.Counter()
    calls, small, functions = 0, 0, []
    classes: collections.Counter[str] = collections.Counter()
    folders: collections.Counter[Path] = collections.Counter()
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text("utf-8")
        part, length = path.relative_to(PACKAGE).parts[0], text.count("\n")
        lines[part if part in PARTS else "core"] += length
        small += length < SMALL
        folders[path.parent] += 1
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                name = f"{path.relative_to(ROOT)}:{node.lineno} {node.name}"
                functions.append((name, node.end_lineno - node.lineno + 1, complexity(node)))
            elif isinstance(node, ast.ClassDef):
                classes[node.name] += 1
            elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "isinstance":
                calls += 1
    folder, most = folders.most_common(1)[0]
    longest = max(functions, key=lambda one: one[1])
    branched = max(functions, key=lambda one: one[2])
    several = sorted(name for name, count in classes.items() if count > 1)
    twins = sorted(name for name in classes if f"_{name}" in classes)
    total = sum(lines.values())
    numbers = {
        **{f"lines of {part}": lines[part] for part in ("core", *PARTS)},
        **{
            f"lines of {name}": lines_of(ROOT / name)
            for name in ("jaxcontact", "tests", "benchmarks")
        },
        "files in one folder": most,
        f"files below {SMALL} lines": small,
        "lines of the longest function": longest[1],
        "largest complexity": branched[2],
        "functions above complexity 10, per 1000": round(
            1000 * sum(one[2] > 10 for one in functions) / len(functions), 1
        ),
        "isinstance per 1000 lines": round(1000 * calls / total, 2),
        "class names with several meanings": len(several),
        "class names that differ by an underscore": len(twins),
    }
    where = {
        "files in one folder": str(folder.relative_to(ROOT)),
        "lines of the longest function": longest[0],
        "largest complexity": branched[0],
        "class names with several meanings": " ".join(several),
        "class names that differ by an underscore": " ".join(twins),
    }
    return numbers, where


def main(words: list[str]) -> int:
    numbers, where = counted()
    limits = json.loads(LIMITS.read_text())
    if "--lower" in words:
        limits = {name: min(limit, numbers[name]) for name, limit in limits.items()}
        LIMITS.write_text(json.dumps(limits, indent=1) + "\n")
    for name in words:
        if not name.startswith("-"):
            ceilings = json.loads(Path(name).read_text())["lines"]
            limits |= {
                f"lines of {part}": min(most, limits[f"lines of {part}"])
                for part, most in ceilings.items()
            }
    print(f"{'':42}{'now':>8}{'limit':>8}")
    for name, value in numbers.items():
        print(f"{name:42}{value:>8}{limits[name]:>8}  {where.get(name, '')}")
    over = [name for name, limit in limits.items() if numbers[name] > limit]
    if over:
        print("above the limit:", ", ".join(over))
    return bool(over)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

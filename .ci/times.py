"""CPU seconds of the tests by file: tracing, lowering, compiling and the rest, without a cache.

    python .ci/times.py                     all of them on two workers; writes tests/times.md
    python .ci/times.py tests/test_scene    arguments of pytest; prints only

JAX says when it begins and ends to trace, to lower and to compile. What remains is running, the
references of the tests, and pytest itself. Time of programs that a test starts counts as remaining.
Each file begins without any program, as if it ran alone. tests/programs.txt holds the number of
programs that a file may compile; a whole run lowers numbers more than a tenth above its own.
"""

from __future__ import annotations

import collections
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "tests" / "times.md"
BUDGETS = ROOT / "tests" / "programs.txt"
KINDS = {
    "/jax/core/compile/jaxpr_trace_duration": "tracing",
    "/jax/core/compile/jaxpr_to_mlir_module_duration": "lowering",
    "/jax/core/compile/backend_compile_duration": "compiling",
}
MOST = 40  # rows of the table of cases

_spent = dict.fromkeys(("all", *KINDS.values(), "programs", "cases"), 0.0)
_open: list[list[float]] = []
_last = dict(_spent)
_rows: dict[str, collections.Counter[str]] = collections.defaultdict(collections.Counter)


def clock() -> float:
    return sum(os.times()[:4])  # of this process and of those it has waited for


def begins(event: str, _: float, **__: object) -> None:
    if event in KINDS:
        _open.append([clock(), 0.0])


def ends(event: str, _: float, **__: object) -> None:
    """What is within counts for itself: a function that is traced in another, say."""
    if event in KINDS and _open:
        start, within = _open.pop()
        whole = clock() - start
        _spent[KINDS[event]] += whole - within
        _spent["programs"] += KINDS[event] == "compiling"
        if _open:
            _open[-1][1] += whole


def since() -> dict[str, float]:
    """What was spent since the last call."""
    _spent["all"] = clock()
    found = {name: value - _last[name] for name, value in _spent.items()}
    _last.update(_spent)
    return found


def pytest_configure(config: pytest.Config) -> None:
    import jax.monitoring

    jax.monitoring.register_scalar_listener(begins)
    jax.monitoring.register_event_duration_secs_listener(ends)


_file = [""]


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Forget the programs of other files."""
    if _file[0] != str(item.path):
        import jax

        _file[0] = str(item.path)
        jax.clear_caches()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    found = since()
    found["cases"] = float(call.when == "call")
    report.user_properties.append(("times", found))
    return report


def pytest_collection_finish() -> None:
    """What went before, imports above all, is no test's."""
    since()


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    for row in (report.nodeid, report.nodeid.partition("::")[0], "all files"):
        _rows[row].update(dict(report.user_properties).get("times", {}))


def line(name: str, found: dict[str, float]) -> str:
    rest = found["all"] - sum(found[kind] for kind in KINDS.values())
    seconds = [found["all"], *(found[kind] for kind in KINDS.values()), rest]
    cells = [f"{x:.1f}" for x in seconds] + [f"{found[x]:.0f}" for x in ("programs", "cases")]
    return f"| {name} | {' | '.join(cells)} |"


def pytest_terminal_summary(terminalreporter, config: pytest.Config) -> None:
    order = sorted(_rows, key=lambda row: -_rows[row]["all"])
    head = ["| CPU s | all | tracing | lowering | compiling | other | programs | cases |"]
    head += ["|---" * 8 + "|"]
    files = [line(row, _rows[row]) for row in order if "::" not in row]
    cases = [line(row, _rows[row]) for row in order if "::" in row][:MOST]
    text = "\n".join([*head, *files, "", "The costliest cases:", "", *head, *cases]) + "\n"
    if written := os.environ.get("JAXCONTACT_TIMES"):
        Path(written).write_text(text)
        lower_budgets()
    terminalreporter.write(text)


def lower_budgets() -> None:
    """Nothing is raised or added here: that is written by hand, and read by a reviewer."""
    rows = []
    for name, most in map(str.split, BUDGETS.read_text().splitlines()):
        # Runs differ by a few. A pytest that a test starts counts none.
        found = int(1.1 * _rows[f"tests/{name}"]["programs"]) + 1
        rows.append(f"{name} {found if 1 < found < int(most) else most}\n")
    BUDGETS.write_text("".join(rows))


def main(arguments: list[str]) -> int:
    environment = dict(os.environ)
    paths = [str(Path(__file__).parent), environment.get("PYTHONPATH", "")]
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, paths))
    environment.pop("JAXCONTACT_TEST_CACHE", None)
    if not arguments:
        environment["JAXCONTACT_TIMES"] = str(RESULT)
    pytest = [sys.executable, "-m", "pytest", "-q", "-n", "2", "-p", "times", *arguments]
    return subprocess.run(pytest, cwd=ROOT, env=environment).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

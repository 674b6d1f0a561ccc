"""The script that plants faults: its faults, its sample, and its resumption."""

import ast
import contextlib
from collections import Counter

from tests import mutate, mutate_faults

SOURCE = '''"""A file with 1 + 1 in its docstring."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    LIMIT = 1 - 2


def f(x: "1 - 1", y=3.0) -> "2 + 2":
    """Not 2 - 1."""
    if not x > 0 or y == 1e-9:
        raise ValueError(f"Argument `x` must be > {1 - 1}")
    assert x is not None
    plot(x, linewidth=0.9)
    é = g(-x, y) + (
        y
        - 5000
    )
    return "a" + é
'''
PATH = "jaxcontact/_room/_f.py"

# Kind, expression and replacement: everything that SOURCE allows. Its docstrings, annotations,
# messages, looks, type checks and text are excluded.
EXPECTED = {
    ("constant", "3.0", "3.3"),
    ("condition", "not x > 0 or y == 1e-09", "not x > 0 and y == 1e-09"),
    ("condition", "not x > 0 or y == 1e-09", "not (not x > 0 or y == 1e-09)"),
    ("dropped check", "not x > 0 or y == 1e-09", "False"),
    ("condition", "x > 0", "x <= 0"),
    ("constant", "0", "1"),
    ("condition", "y == 1e-09", "y != 1e-09"),
    ("constant", "1e-09", "1e-06"),
    ("sign", "g(-x, y) + (y - 5000)", "g(-x, y) - (y - 5000)"),
    ("swapped argument", "g(-x, y)", "g(y, -x)"),
    ("sign", "-x", "+x"),
    ("sign", "y - 5000", "y + 5000"),
    ("constant", "5000", "500"),
}


def test_all_kinds_are_found_and_only_in_what_runs():
    found = mutate_faults.faults(PATH, SOURCE)
    assert {(x.kind, x.old, x.new) for x in found} == EXPECTED
    assert len(found) == len(EXPECTED)
    assert {x.kind for x in found} == set(mutate_faults.KINDS)
    assert {x.scope for x in found if x.old != "3.0"} == {"f"}


def test_the_draw_covers_all_rooms_and_kinds_and_is_repeatable():
    sources = mutate.read(mutate.ROOT, mutate.PACKAGE)
    drawn = mutate_faults.sample(sources, 68, 0)
    assert len(set(drawn)) == len(drawn) == 68
    rooms = {mutate_faults.room_of(path) for path in sources}
    # These have no line that can be wrong.
    assert {x.room for x in drawn} == rooms - {"data", "jaxsim", "mjx"}
    counts = Counter(x.kind for x in drawn)
    assert set(counts) == set(mutate_faults.KINDS) and min(counts.values()) >= 8
    for x in drawn:
        ast.parse(mutate_faults.plant(sources[x.path], x))
    few = {path: sources[path] for path in sorted(sources)[:9]}
    first, again, other = (mutate_faults.sample(few, 9, seed) for seed in (0, 0, 1))
    assert first == again != other


def test_the_tests_of_a_room_come_first_and_then_those_above():
    sources = {
        "jaxcontact/_low.py": "def f(x):\n    return -x\n",
        "jaxcontact/_high/_a.py": "from .._low import f\n",
        "jaxcontact/_higher.py": "def g():\n    from ._high import f\n",
        "jaxcontact/_aside.py": "",
    }
    tests = {
        "tests/test_low.py": "slow, but calls f",
        "tests/test_low_edges.py": "quick",
        "tests/test_high/test_a.py": "",
        "tests/test_high/support.py": "",
        "tests/test_higher.py": "",
        "tests/test_aside.py": "",
        "tests/test_readme.py": "import jaxcontact",
        "tests/test_oracle.py": "",
    }
    (fault,) = mutate_faults.faults("jaxcontact/_low.py", sources["jaxcontact/_low.py"])
    direct = mutate.importers(sources)
    own, others = mutate.stages(fault, sources, direct, tests, {"tests/test_low.py": 9.0})
    # The one that names the function first, then the quick one.
    assert own == ["tests/test_low.py", "tests/test_low_edges.py"]
    above = "test_high/test_a", "test_higher", "test_readme"
    assert set(others) == {f"tests/{name}.py" for name in above}
    top = {**sources, "jaxcontact/__main__.py": "from ._higher import g\n\ng(-1)\n"}
    (fault, _) = mutate_faults.faults("jaxcontact/__main__.py", top["jaxcontact/__main__.py"])
    own, others = mutate.stages(fault, top, mutate.importers(top), tests, {})
    assert (own, others) == (["tests/test_higher.py"], ["tests/test_readme.py"])


def test_a_run_goes_on_where_it_stopped(tmp_path, monkeypatch):
    drawn, results = mutate_faults.faults(PATH, SOURCE), tmp_path / "results.jsonl"
    signs = [x for x in drawn if x.kind == "sign"]

    def run(package, tests, most=None):
        """The faults that are run, up to an interruption."""
        ran, marks = [], {"package": package, "tests": tests}

        def one(fault):
            if len(ran) == most:
                raise KeyboardInterrupt
            ran.append(fault)
            return ("survived", "") if fault in signs else ("killed", "tests/test_f.py::test")

        with contextlib.suppress(KeyboardInterrupt):
            mutate.run(drawn, results, marks, one)
        return ran

    assert run("a", "a", most=3) == drawn[:3]
    assert run("a", "a") == drawn[3:]
    assert run("a", "a") == []
    assert run("a", "b") == signs
    assert run("b", "b") == drawn
    text = mutate.table(drawn, mutate.known(results, {"package": "b", "tests": "b"}, drawn))
    assert "10 killed, 3 survived; 0 minutes" in text
    assert "| sign | 0 | 3 |" in text and "| condition | 4 | 0 |" in text
    assert text.count("no test fails yet") == 3
    # A fault with a reason need not be run again after the tests have changed.
    monkeypatch.setitem(mutate.REASONS, signs[0].change, "the reason")
    assert run("b", "c") == signs[1:]


def test_a_trial_leaves_the_tree_as_it_was(tmp_path):
    path = tmp_path / PATH
    path.parent.mkdir(parents=True)
    path.write_text(SOURCE, encoding="utf-8")
    fault = mutate_faults.faults(PATH, SOURCE)[0]
    seen, statuses = [], []

    def pytest_in(where, *arguments):
        seen.append((arguments[1:], path.read_text(encoding="utf-8") != SOURCE))
        return statuses.pop(0), "FAILED tests/test_f.py::test[1 2] - AssertionError\n"

    stages = (["own"], ["above"])
    for given, outcome in [
        ([0, 0], ("survived", "")),
        ([0, 1], ("killed", "tests/test_f.py::test[1 2]")),
        ([1], ("killed", "tests/test_f.py::test[1 2]")),
    ]:
        statuses[:] = given
        assert mutate.trial(fault, tmp_path, stages, pytest_in) == outcome
    assert seen == [(("own",), True), (("above",), True)] * 2 + [(("own",), True)]
    assert path.read_text(encoding="utf-8") == SOURCE

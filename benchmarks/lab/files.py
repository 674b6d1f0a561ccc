"""Time to read tables of 100,000 rows, compared with a reader written for their format.

The reference uses `str.split` and `float` for each line, handles
a decimal comma or a time if the format has one, and checks nothing.
"""

from __future__ import annotations

import io
import time
from collections.abc import Callable

import numpy as np

import jaxcontact as jc
from benchmarks.study import Study, lines
from jaxcontact.lab.tables.grid import is_number
from jaxcontact.lab.tables.source import sheet_of

ROWS = 100_000

LIMIT = 3.0
"""In s: more than this over reading by hand is a defect."""


def _comma(number: float, digits: int = 6) -> str:
    return f"{number:.{digits}f}".replace(".", ",")


def _clock(number: float) -> str:
    return f"{int(number // 60):02d}:{number % 60:05.2f}"


def _seconds(text: str) -> float:
    minutes, seconds = text.split(":")
    return 60 * float(minutes) + float(seconds)


def forms(rows: int = ROWS) -> dict[str, tuple[str, Callable[[str], list[float]]]]:
    """Texts of tables by the name of their form, and how each line is read by hand."""
    random = np.random.default_rng(0)
    t = np.arange(rows) * 1e-4
    table = np.stack([t, *random.normal(size=(3, rows))], axis=1)
    table[:, 3] += 300 * np.clip(np.sin(2 * np.pi * t / 0.5) * 20 - 19, 0, 1)
    speeds = np.stack([random.uniform(0.5, 4, rows), random.uniform(0.7, 0.9, rows)], axis=1)
    heads = ("abs time (s)", "Fx", "Fy", "Fz")

    def text(rows: np.ndarray, head: str, between: str, word: Callable[[float], str]) -> str:
        return head + "\n" + "".join(between.join(map(word, row)) + "\n" for row in rows)

    def point(number: float) -> str:
        return f"{number:.6f}"

    def by(between: str | None) -> Callable[[str], list[float]]:
        return lambda line: [float(one) for one in line.split(between)]

    def german(line: str) -> list[float]:
        return [float(one.replace(",", ".")) for one in line.split(";")]

    laps = np.stack([np.arange(1, rows + 1), np.tile(0.8 * 0.9 ** np.arange(10), rows // 10)], 1)
    lines = "".join(f"{k % 10 + 1},{k // 10},{_clock(one)}\n" for k, (_, one) in enumerate(laps))
    return {
        "commas": (text(table, ",".join(heads), ",", point), by(",")),
        "tabs": (text(table, "\t".join(heads), "\t", point), by("\t")),
        "blanks": (text(table, "t Fx Fy Fz", "  ", point), by(None)),
        "decimal commas": (text(table, ";".join(heads) + "\ns;N;N;N", ";", _comma), german),
        "speeds": (text(speeds, "v,e", ",", point), by(",")),
        "mm:ss.cc": (
            "Lap,Trial,Lap time\n" + lines,
            lambda line: [float(line.split(",")[0]), _seconds(line.split(",")[2])],
        ),
    }


def by_hand(text: str, line: Callable[[str], list[float]]) -> np.ndarray:
    """The numbers of a table whose form is known."""
    lines = text.splitlines()[1:]
    return np.array([line(one) for one in lines if is_number(one[0])])


def measured(text: str, line: Callable[[str], list[float]]) -> list[float]:
    """Processor seconds by hand, for the columns of a file, and for the recording in it."""
    times = []
    for read in (
        lambda: by_hand(text, line),
        lambda: sheet_of(io.StringIO(text), {}, lambda word: word in ("v", "Lap time", "Fz")),
        lambda: jc.read_recording(io.StringIO(text)),
    ):
        start = time.process_time()
        read()
        times.append(time.process_time() - start)
    return times


def measure(known: None) -> dict[str, list[float]]:
    jc.read_recording(io.StringIO(forms(6000)["commas"][0]))  # imports SciPy
    return {name: measured(text, line) for name, (text, line) in forms().items()}


def rows(found: dict[str, list[float]]) -> str:
    late = {name: "" if whole - hand < LIMIT else "yes" for name, (hand, _, whole) in found.items()}
    cells = [[name, *(f"{x:.2f}" for x in times), late[name]] for name, times in found.items()]
    heads = ["s of CPU", "by hand", "text to columns", "recording", "more than allowed"]
    return lines(heads, cells)


STUDY = Study(__file__, __doc__, measure, rows)

"""Runs the code of the pages: what a ```python block prints is the ```text block that follows it.

`python docs/run_code.py PAGE ...` writes what was printed into the pages; the tests compare. The
blocks of a page run in order, in one namespace and in a folder of their own. A comment above a
block says what is different here:

    <!-- not run: why -->
    <!-- run as: this text, here => that text -->
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

DOCS = Path(__file__).parent
BLOCK = re.compile(
    r"^(?:<!-- (?P<how>.*?) -->\n)?```python\n(?P<code>.*?)^```$"
    r"(?:\n\n```text\n(?P<shown>.*?)^```$)?",
    re.DOTALL | re.MULTILINE,
)


@dataclass(frozen=True)
class Block:
    """A block of code as it is run, what the page shows for it (None: nothing), and where."""

    code: str
    shown: str | None
    line: int
    place: tuple[int, int]


def pages() -> list[Path]:
    """The pages that have code."""
    return [p for p in sorted(DOCS.rglob("*.md")) if BLOCK.search(p.read_text(encoding="utf-8"))]


def blocks(page: Path) -> list[Block]:
    """The blocks of a page that are run."""
    text = page.read_text(encoding="utf-8")
    found = []
    for match in BLOCK.finditer(text):
        kind, _, rest = (match["how"] or "").partition(": ")
        code = match["code"]
        if kind == "not run":
            assert rest, f"{page}: why is a block not run?"
            continue
        if kind == "run as":
            here, _, there = rest.partition(" => ")
            assert code.count(here) == 1, f"{page}: {here!r} is not there once"
            code = code.replace(here, there)
        line = text.count("\n", 0, match.start("code"))
        found.append(Block(code, match["shown"], line, match.span("shown")))
    return found


def run(page: Path) -> Iterator[tuple[Block, str]]:
    """Each block of a page, and what it prints."""
    names: dict[str, object] = {"__name__": "__main__"}
    start = os.getcwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            for block in blocks(page):
                # Errors then name the line of the page.
                program = compile(
                    "\n" * block.line + block.code, str(page), "exec", dont_inherit=True
                )
                with contextlib.redirect_stdout(io.StringIO()) as out:
                    exec(program, names)
                yield block, out.getvalue()
        finally:
            os.chdir(start)


def digits(text: str) -> str:
    """The text with its numbers at six digits: the last ones are the compiler's.

    So is how many steps of a search it took until rounding left none.
    """
    text = re.sub(r"in \d+ steps", "in a few steps", text)
    text = re.sub(r"-?\d+\.\d+(e[-+]?\d+)?", lambda found: f"{float(found[0]):.6g}", text)
    return "\n".join(line.rstrip() for line in text.splitlines())


def write(page: Path) -> None:
    """Write what was printed into a page, where more than the last digits differ."""
    text = page.read_text(encoding="utf-8")
    for block, printed in reversed(list(run(page))):
        if block.shown is not None and digits(block.shown) != digits(printed):
            first, last = block.place
            printed = "".join(f"{line.rstrip()}\n" for line in printed.splitlines())
            text = text[:first] + printed + text[last:]
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    os.environ.setdefault("MPLBACKEND", "Agg")
    for name in sys.argv[1:]:
        write(Path(name).resolve())

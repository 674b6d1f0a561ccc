"""The code of the pages: each ```text block shows the output of the ```python block above it.

`python docs/run_code.py PAGE ...` writes the output into the pages; the tests compare. The blocks
of a page run in order, in one namespace and one temporary folder. A comment above a block changes
how it is run:

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
    r"^(?:<!-- (?P<how>[^\n]*) -->\n)?```python\n(?P<code>.*?)^```$"
    r"(?:\n\n```text\n(?P<shown>.*?)^```$)?",
    re.DOTALL | re.MULTILINE,
)


@dataclass(frozen=True)
class Block:
    """A block of code as it is run, the output shown for it (None: nothing), and their places."""

    code: str
    shown: str | None
    line: int
    place: tuple[int, int]


def pages() -> list[Path]:
    """Return the pages that have code."""
    return [p for p in sorted(DOCS.rglob("*.md")) if BLOCK.search(p.read_text(encoding="utf-8"))]


def blocks(page: Path) -> list[Block]:
    """Return the blocks of a page that are run."""
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
    """Yield each block of a page and its output."""
    names: dict[str, object] = {"__name__": "__main__"}
    start = os.getcwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            for block in blocks(page):
                # The padding makes errors name the line of the page.
                program = compile(
                    "\n" * block.line + block.code, str(page), "exec", dont_inherit=True
                )
                with contextlib.redirect_stdout(io.StringIO()) as out:
                    exec(program, names)
                yield block, out.getvalue()
        finally:
            os.chdir(start)


def digits(text: str) -> str:
    """Return the text with numbers at six digits, since the last ones depend on the compiler.

    So do the number of steps of a search that ends by rounding, and all but the power of ten of an
    error near rounding.
    """
    text = re.sub(r"in \d+ steps", "in a few steps", text)
    text = re.sub(r"(error +)\d(\.\d+)?e", r"\1e", text)
    text = re.sub(r"-?\d+\.\d+(e[-+]?\d+)?", lambda found: f"{float(found[0]):.6g}", text)
    return "\n".join(line.rstrip() for line in text.splitlines())


def write(page: Path) -> None:
    """Write the output into a page where more than the last digits differ."""
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

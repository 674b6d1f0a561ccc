"""The parts of a report: facts, tables and listings, each as text and as HTML."""

from __future__ import annotations

import dataclasses
import html
import re
import textwrap
from collections.abc import Iterable, Sequence

from ...extend import text_table, wrapped

Row = tuple[str, ...]

_WIDTH = 100
_CODE = re.compile(r"`([^`]+)`|(?<![\w-])(--[a-z][a-z-]*)")


@dataclasses.dataclass(frozen=True)
class Fact:
    """A sentence beside its heading, or, without one, the continuation of the fact before.

    The text is cut after `most` lines; 0 prints all. Nothing is shown of an empty sentence.
    """

    head: str
    said: str
    most: int = 0

    def text(self) -> list[str]:
        lines = wrapped(self.head, self.said, width=_WIDTH)
        if not self.most or len(lines) <= self.most:
            return lines
        last = textwrap.shorten(
            " ".join(line.strip() for line in lines[self.most - 1 :]),
            _WIDTH - 11,
            placeholder=" ... (--details)",
            break_on_hyphens=False,
        )
        return [*lines[: self.most - 1], " " * 11 + last]

    def html(self) -> Html:
        if not self.said or not self.head:
            return paragraphs(self.said)
        return element("dl", element("dt", self.head), element("dd", sentence(self.said)))


@dataclasses.dataclass(frozen=True)
class Rows:
    """Rows below a header; nothing without rows.

    `align` has "<" for a column of words and ">" for one of numbers, as in `text_table`. `lines`
    replace the rows in a text.
    """

    header: Row
    rows: Sequence[Row]
    align: str = ""
    lines: Sequence[str] = ()

    def text(self) -> list[str]:
        if self.lines:
            return [f"  {line}" for line in self.lines]
        rows = text_table(self.rows, header=self.header, align=self.align, indent=2)
        return rows if self.rows else []

    def html(self) -> Html:
        """Return a table that scrolls sideways if it is too wide."""
        if not self.rows:
            return Html("")
        marks = [{"class_": "number"} if side == ">" else {} for side in self.align]
        marks += [{}] * (max(map(len, self.rows)) - len(marks))

        def cells(row: Row, name: str) -> Html:
            both = zip(row, marks, strict=False)
            return element("tr", *(element(name, cell, **mark) for cell, mark in both))

        head = element("thead", cells(self.header, "th")) if any(self.header) else Html("")
        body = element("tbody", *(cells(row, "td") for row in self.rows))
        return element("div", element("table", head, body), class_="wide")


@dataclasses.dataclass(frozen=True)
class Listing:
    """Names with their values, below a title."""

    title: str
    rows: Sequence[tuple[str, str]]

    def text(self) -> list[str]:
        lines = [wrapped(name, said, indent=20, lead="    ") for name, said in self.rows]
        return [f"  {self.title}", *(line for part in lines for line in part)]

    def html(self) -> Html:
        return joined([element("h3", self.title), Rows((), self.rows).html()])


Part = Fact | Rows | Listing


class Html(str):
    """A text that is already HTML; any other text is escaped when inserted."""

    __slots__ = ()


def escaped(content: str) -> Html:
    """Return the HTML of a text, with options and what stands in backquotes as code."""
    if isinstance(content, Html):
        return content
    return Html(_CODE.sub(r"<code>\1\2</code>", html.escape(content)))


def joined(parts: Iterable[str]) -> Html:
    """Join parts, each on its own line."""
    return Html("\n".join(escaped(part) for part in parts if part))


def element(name: str, *content: str, **attributes: str) -> Html:
    """Return an element with its content; `class_` is the attribute `class`."""
    given = "".join(
        f' {key.rstrip("_")}="{html.escape(value)}"' for key, value in attributes.items()
    )
    return Html(f"<{name}{given}>{''.join(map(escaped, content))}</{name}>")


def paragraphs(*sentences: str) -> Html:
    """Return a paragraph for each sentence, with a capital and a full stop."""
    return joined(element("p", sentence(one)) for one in sentences if one)


def sentence(words: str) -> str:
    """Return words with a capital and a full stop."""
    end = "" if words.rstrip().endswith((".", ":", "?")) else "."
    first = words.split(maxsplit=1)[0]
    # A symbol or a name, such as e or interval_s, keeps its case.
    plain = len(first) > 1 and first.rstrip(",;:").replace("-", "").isalpha()
    return (words[0].upper() + words[1:] if plain else words) + end

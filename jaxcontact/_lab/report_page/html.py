"""HTML in which all text is escaped, unless it was made here."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence


class Html(str):
    """A text that is already HTML; any other text is escaped when inserted."""

    __slots__ = ()


def text(content: str) -> Html:
    """Return the HTML of a text."""
    return content if isinstance(content, Html) else Html(html.escape(content))


def joined(parts: Iterable[str]) -> Html:
    """Join parts, each on its own line."""
    return Html("\n".join(text(part) for part in parts if part))


def element(name: str, *content: str, **attributes: str) -> Html:
    """Return an element with its content; `class_` is the attribute `class`."""
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{html.escape(value)}"'
        for key, value in attributes.items()
    )
    inside = "".join(text(part) for part in content)
    return Html(f"<{name}{given}>{inside}</{name}>")


def section(title: str, *content: str) -> Html:
    """Return a section with a heading; empty without content."""
    return element("section", element("h2", title), *content) if any(content) else Html("")


def paragraphs(*sentences: str) -> Html:
    """Return a paragraph for each sentence, with a capital and a full stop."""
    return joined(element("p", _sentence(one)) for one in sentences if one)


def _sentence(words: str) -> str:
    if isinstance(words, Html):
        return words
    end = "" if words.rstrip().endswith((".", ":", "?")) else "."
    first = words.split(maxsplit=1)[0]
    # A symbol or a name, such as e or interval_s, keeps its case.
    plain = len(first) > 1 and first.rstrip(",;:").isalpha()
    return (words[0].upper() + words[1:] if plain else words) + end


def table(header: Sequence[str], rows: Sequence[Sequence[str]], *, left: int = 1) -> Html:
    """Return a table that scrolls sideways if it is too wide; empty without rows.

    The first `left` columns are words, the others numbers. A row of one cell is a heading.
    """
    if not rows:
        return Html("")

    def cells(row: Sequence[str], name: str) -> Html:
        if len(row) == 1:
            return element("tr", element("th", row[0], colspan=str(len(header)), scope="rowgroup"))
        marks = [{} if k < left else {"class_": "number"} for k in range(len(row))]
        both = zip(row, marks, strict=True)
        return element("tr", *(element(name, cell, **mark) for cell, mark in both))

    head = element("thead", cells(header, "th")) if any(header) else Html("")
    body = element("tbody", *(cells(row, "td") for row in rows))
    return element("div", element("table", head, body), class_="wide")


def definitions(rows: Iterable[tuple[str, str]]) -> Html:
    """Return a definition list of terms and sentences."""
    parts = (part for a, b in rows for part in (element("dt", a), element("dd", _sentence(b))))
    return element("dl", *parts)


def picture(svg: bytes, words: str) -> Html:
    """Return a picture embedded in the page, with its caption."""
    source = "data:image/svg+xml;base64," + base64.b64encode(svg).decode()
    image = Html(f'<img src="{source}" alt="{html.escape(words)}">')
    return element("figure", image, element("figcaption", words))

"""HTML in which all text is escaped, unless it was made here."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence


class Html(str):
    """A text that is HTML already; every other one is escaped where it is put into some."""

    __slots__ = ()


def text(content: str) -> Html:
    """The HTML of a text."""
    return content if isinstance(content, Html) else Html(html.escape(content))


def joined(parts: Iterable[str]) -> Html:
    """Parts one after another, each on a line of its own."""
    return Html("\n".join(text(part) for part in parts if part))


def element(name: str, *content: str, **attributes: str) -> Html:
    """An element with its content; `class_` stands for `class`."""
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{html.escape(value)}"'
        for key, value in attributes.items()
    )
    inside = "".join(text(part) for part in content)
    return Html(f"<{name}{given}>{inside}</{name}>")


def section(title: str, *content: str) -> Html:
    """A section with a heading; nothing where it has no content."""
    return element("section", element("h2", title), *content) if any(content) else Html("")


def paragraphs(*sentences: str) -> Html:
    """A paragraph for each sentence, with a capital and a full stop."""
    return joined(element("p", _sentence(one)) for one in sentences if one)


def _sentence(words: str) -> str:
    if isinstance(words, Html):
        return words
    end = "" if words.rstrip().endswith((".", ":", "?")) else "."
    first = words.split(maxsplit=1)[0]
    # A symbol or a name, such as e or interval_s, stays as it is.
    plain = len(first) > 1 and first.rstrip(",;:").isalpha()
    return (words[0].upper() + words[1:] if plain else words) + end


def table(header: Sequence[str], rows: Sequence[Sequence[str]], *, left: int = 1) -> Html:
    """A table that scrolls sideways where it is too wide; nothing without rows.

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
    """A list of words and what is said of each."""
    parts = (part for a, b in rows for part in (element("dt", a), element("dd", _sentence(b))))
    return element("dl", *parts)


def picture(svg: bytes, words: str) -> Html:
    """A picture inside the page, with the words that say what it shows."""
    source = "data:image/svg+xml;base64," + base64.b64encode(svg).decode()
    image = Html(f'<img src="{source}" alt="{html.escape(words)}">')
    return element("figure", image, element("figcaption", words))

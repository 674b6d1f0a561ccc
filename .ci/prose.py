"""Prose linter of the house: `python .ci/prose.py [PATHS]` prints `file:line: rule: sentence`.

It reads docstrings and comments of Python files, and the text of Markdown pages without code blocks,
tables, headings and generated parts. It fails if a folder holds more findings than `ALLOWED`.
`--all` prints the allowed findings too, `--count` only their number by folder.
"""

from __future__ import annotations

import ast
import collections
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PLACES = ("jaxcontact", "docs", "README.md", "CONTRIBUTING.md")

LONGEST = 30
RULES = {
    "opens with Who": re.compile(r"Who\b"),
    "opens with What ... is": re.compile(r"What\b.*\bis\b"),
    "opens with Whether": re.compile(r"Whether\b"),
    "opens with That of": re.compile(r"That of\b"),
    "is none": re.compile(r".*(?<!there )\b(is none\b|are none of\b)"),
    "is told": re.compile(r".*\bis told\b"),
    "knows": re.compile(r".*\bknows\b"),
}
"""Patterns that a sentence must not match at its beginning."""

ALLOWED: dict[str, int] = {}
"""Findings that a folder may hold, by the longest path that contains the file. Only lower them."""

# A sentence ends before a capital, a quoted name or a bracket, unless an abbreviation comes first.
_END = re.compile(
    r"(?<=[.!?])(?<!\b[A-Z]\.)(?<!e\.g\.)(?<!i\.e\.)(?<!al\.)(?<!Eq\.)\s+(?=[^\sa-z])"
)
_WORD = re.compile(r"[A-Za-z][A-Za-z'’-]+|\ba\b")
_GENERATED = re.compile(r"<!-- *(table of|results|made by)\b.*?(<!-- *end of table *-->|\Z)", re.S)
_SKIPPED = re.compile(r"```.*?```|<style.*?</style>|<!--.*?-->|^ *\|.*?$|^#.*?$", re.S | re.M)


def words(sentence: str) -> int:
    """Count the words of a sentence; in a list after a colon, those of its longest member."""
    plain = re.sub(r"`[^`]*`", " name ", sentence)
    members = plain.split(";") if ":" in plain.split(";")[0] else [plain]
    return max(len(_WORD.findall(member)) for member in members)


def broken_rule(sentence: str) -> str | None:
    """Return the first rule that a sentence breaks, or None."""
    # References are bibliographies, not sentences.
    if words(sentence) > LONGEST and not sentence.startswith("Source"):
        return f"more than {LONGEST} words"
    return next((rule for rule, pattern in RULES.items() if pattern.match(sentence)), None)


def python_texts(text: str) -> Iterator[tuple[int, str]]:
    """Yield the docstrings and the comments of a Python file with their first lines."""
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.Expr(value=ast.Constant(value=str(words))):
                yield node.lineno, words
    start, last, block = 0, -1, ""
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type != tokenize.COMMENT:
            continue
        line, comment = token.start[0], token.string.lstrip("#").strip()
        if line == last + 1:
            block += " " + comment
        else:
            yield start, block
            start, block = line, comment
        last = line
    yield start, block


def markdown_texts(text: str) -> Iterator[tuple[int, str]]:
    """Yield the text of a Markdown page with its first line."""

    def blank(match: re.Match[str]) -> str:
        return "\n" * match[0].count("\n")

    text = _SKIPPED.sub(blank, _GENERATED.sub(blank, text))
    yield 1, re.sub(r"\]\([^)]*\)", "]", text)


def sentences(first: int, text: str) -> Iterator[tuple[int, str]]:
    """Yield the sentences of a text with their lines; a list item begins a new one."""
    line = first
    for part in re.split(r"(\n\s*\n|\n\s*(?=[-*] |\d+\. ))", text):
        at = line
        for sentence in _END.split(part):
            if sentence.strip():
                lead = len(sentence) - len(sentence.lstrip())
                yield at + sentence[:lead].count("\n"), " ".join(sentence.split()).lstrip("-*> ")
            at = line + part[: part.find(sentence) + len(sentence)].count("\n")
        line += part.count("\n")


def findings(path: Path) -> Iterator[tuple[int, str, str]]:
    """Yield the line, the rule and the sentence of every finding in a file."""
    texts = python_texts if path.suffix == ".py" else markdown_texts
    for first, text in texts(path.read_text(encoding="utf-8")):
        for line, sentence in sentences(first, text):
            if rule := broken_rule(sentence):
                yield line, rule, sentence


def folder_of(path: Path) -> str:
    """Return the longest path of `ALLOWED` that contains a file, or its own folder."""
    name = path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else path.as_posix()
    holders = [place for place in ALLOWED if name == place or name.startswith(place + "/")]
    return max(holders, key=len, default=name.rpartition("/")[0])


def main(arguments: list[str]) -> int:
    options = {word for word in arguments if word.startswith("--")}
    paths = [Path(word).resolve() for word in arguments if word not in options]
    files = [
        file
        for path in paths or [ROOT / place for place in PLACES]
        for file in (
            sorted([*path.rglob("*.py"), *path.rglob("*.md")]) if path.is_dir() else [path]
        )
    ]
    found = collections.defaultdict(list)
    for file in files:
        name = file.relative_to(ROOT) if file.is_relative_to(ROOT) else file
        found[folder_of(file)] += [
            f"{name}:{line}: {rule}: {s}" for line, rule, s in findings(file)
        ]
    failed = False
    for folder, lines in sorted(found.items()):
        allowed = ALLOWED.get(folder, 0)
        failed = failed or len(lines) > allowed
        if "--count" in options:
            print(f"{folder}: {len(lines)}")
        elif len(lines) > allowed or "--all" in options:
            print(*lines, f"{folder}: {len(lines)} findings, {allowed} allowed", sep="\n")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Prose linter of the house: `python .ci/prose.py [PATHS]` prints `file:line: rule: sentence`.

It reads docstrings, comments and printed strings of Python files, and the text of Markdown pages.
Printed are arguments of an exception that is raised, `help=`, and the constants `PRINTED`. Code
blocks, tables, headings and generated parts of pages are skipped. It fails if a folder holds
more findings than `ALLOWED`. `--all` prints the allowed findings too, `--count` the number of each
folder.
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

PRINTED = ("SUMMARY", "DESCRIPTION", "EPILOG", "_EPILOG")
"""Names of constants that the command line prints."""

TABLES = ("OPTIONS", "TABLE", "AIR", "GRAVITY")
"""Names of tables of options, whose last column the command line prints."""

_COLUMNS = re.compile(r"^[^|\n]*\|[^|\n]*\|", re.MULTILINE)

LONGEST = 30
"""Words of a sentence; in a list after a colon, words of a member."""

RULES = {
    "opens with Who": r"Who\b",
    "opens with What ... is": r"What\b.*\bis\b",
    "opens with Whether": r"Whether\b",
    "opens with That of": r"That of\b",
    "is none": r".*(?<!there )\bis none\b|.*\bare none of\b",
    "is told": r".*\bis told\b",
    "knows": r".*\bknows\b",
}
"""Patterns that no sentence may match at its beginning."""

ALLOWED = {
    "docs": 13,
    "jaxcontact/lab": 2,
    "jaxcontact/lab/choice": 1,
    "jaxcontact/lab/cli/commands": 2,
    "jaxcontact/_fit": 2,
    "jaxcontact/_fit/posterior": 1,
    "jaxcontact/_fit/uncertainty": 2,
    "jaxcontact/lab/recordings": 2,
    "jaxcontact/lab/records": 2,
}
"""Findings that a folder may still hold. Lower these numbers, never raise them."""

# A sentence ends before anything but a lower-case letter, unless an abbreviation comes first.
_END = re.compile(r"(?<=[.!?])(?<!\b[A-Z]\.)(?<!\.[eg]\.)(?<!al\.)(?<!Eq\.)\s+(?=[^\sa-z])")
_ITEM = re.compile(r"(\n\s*\n|\n\s*(?=[-*] |\d+\. ))")
_WORD = re.compile(r"[A-Za-z][A-Za-z'’-]+|\ba\b")
_SKIPPED = re.compile(
    r"<!-- *(?:table of|results|made by)\b.*?(?:<!-- *end of table *-->|\Z)|<!--.*?-->|```.*?```"
    r"|^ *\|[^\n]*|^#[^\n]*|(?<=\])\([^)\n]*\)",
    re.DOTALL | re.MULTILINE,
)


def broken_rule(sentence: str) -> str | None:
    """Return the rule that a sentence breaks, or None."""
    members = re.sub(r"`[^`]*`", "name", sentence).split(";")
    parts = members if ":" in members[0] else [" ".join(members)]
    too_long = max(len(_WORD.findall(part)) for part in parts) > LONGEST
    # References are not sentences.
    if too_long and not sentence.startswith("Source"):
        return f"more than {LONGEST} words"
    return next((rule for rule, pattern in RULES.items() if re.match(pattern, sentence)), None)


def texts_of(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the texts of a file with their first lines."""
    source = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        yield 1, _SKIPPED.sub(lambda match: "\n" * match[0].count("\n"), source)
        return
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Expr(value=ast.Constant(value=str(text))):
                yield node.lineno, text
            case ast.Raise(exc=ast.Call(args=printed)):
                yield from _strings(*printed)
            case ast.keyword(arg="help", value=printed):
                yield from _strings(printed)
            case ast.Assign(targets=[ast.Name(id=name)], value=printed) if name in PRINTED:
                yield from _strings(printed)
            case ast.Assign(targets=[ast.Name(id=name)], value=printed) if name in TABLES:
                yield from ((at, _COLUMNS.sub("- ", text)) for at, text in _strings(printed))
    blocks: dict[int, list[str]] = {}
    last, first = -1, 0
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            line = token.start[0]
            first = first if line == last + 1 else line
            blocks.setdefault(first, []).append(token.string.lstrip("# "))
            last = line
    yield from ((line, "\n".join(block)) for line, block in blocks.items())


def _strings(*printed: ast.expr) -> Iterator[tuple[int, str]]:
    """Yield the strings among expressions; a formatted value is one word."""
    for node in printed:
        match node:
            case ast.Constant(value=str(text)):
                yield node.lineno, text
            case ast.JoinedStr(values=parts):
                words = (getattr(part, "value", "") for part in parts)
                yield node.lineno, "".join(w if isinstance(w, str) else "name" for w in words)


def findings(path: Path) -> Iterator[str]:
    """Yield the findings in a file as lines."""
    name = path.relative_to(ROOT) if path.is_relative_to(ROOT) else path
    for line, text in texts_of(path):
        for part in _ITEM.split(text):
            at = 0
            for sentence in _END.split(part):
                at = part.index(sentence, at)
                lead = len(sentence) - len(sentence.lstrip())
                words = " ".join(sentence.split()).lstrip("-*> ")
                if rule := broken_rule(words):
                    yield f"{name}:{line + part[: at + lead].count(chr(10))}: {rule}: {words}"
            line += part.count("\n")


def main(arguments: list[str]) -> int:
    options = {word for word in arguments if word.startswith("--")}
    given = [Path(word).resolve() for word in arguments if word not in options]
    found: collections.defaultdict[str, list[str]] = collections.defaultdict(list)
    for path in given or [ROOT / place for place in PLACES]:
        for file in sorted([*path.rglob("*.py"), *path.rglob("*.md")]) if path.is_dir() else [path]:
            folder = file.parent.relative_to(ROOT) if file.is_relative_to(ROOT) else file.parent
            found[folder.as_posix()] += findings(file)
    failed = False
    for folder, lines in sorted(found.items()):
        allowed = ALLOWED.get(folder, 0)
        failed = failed or len(lines) > allowed
        if lines and ("--all" in options or len(lines) > allowed):
            print(*lines, sep="\n")
        if "--count" in options or len(lines) > allowed:
            print(f"{folder}: {len(lines)} findings, {allowed} allowed")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

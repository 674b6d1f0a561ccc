"""Reader of the table of engines in docs/export.md."""

import re
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "export.md"


def rows():
    """The cells of the table's lines, as text."""
    _, _, after = PAGE.read_text(encoding="utf-8").partition("\n## Engines\n")
    section = after.partition("\n## ")[0]
    lines = [x for x in section.splitlines() if x.startswith("| `")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def variant(row):
    """The engine and the value of its option, as in ("lammps", "tsuji")."""
    values = re.findall(r"`([^`]*)`", row[0])
    return (values[0], *(int(x) if x.isdigit() else x for x in values[1:]))


def measured():
    """What each engine delivered where 0.5 was wanted."""
    found = {variant(row): float(row[4]) for row in rows() if row[4] != "not run"}
    return {**found, ("exudyn",): found["exudyn", 2]} if found else {}

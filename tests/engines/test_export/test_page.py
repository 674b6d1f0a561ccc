"""The numbers of docs/export.md equal those of the exports; tests/test_docs runs its code."""

import re
from pathlib import Path

import pytest

import jaxcontact as jc
from jaxcontact.engines import engines, export

PAGE = Path(__file__).parents[3] / "docs" / "export.md"
OPTION = {"drake": "discrete_contact_approximation", "exudyn": "impact_model", "lammps": "damping"}


def rows():
    """The cells of the table's lines, as text."""
    text = PAGE.read_text(encoding="utf-8").partition("## Engines")[2].partition("\n## ")[0]
    lines = [x for x in text.splitlines() if x.startswith("| `")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def variant(row):
    """The engine and the value of its option, as in ("lammps", "tsuji")."""
    values = re.findall(r"`([^`]*)`", row[0])
    return (values[0], *(int(x) if x.isdigit() else x for x in values[1:]))


def measured():
    """What each engine delivered where 0.5 was wanted."""
    found = {variant(row): float(row[4]) for row in rows() if row[4] != "not run"}
    return {**found, ("exudyn",): found["exudyn", 2]} if found else {}


@pytest.mark.parametrize("row", rows(), ids=lambda row: "-".join(map(str, variant(row))))
def test_the_table_says_what_the_export_says(row):
    engine, *values = variant(row)
    options = {OPTION[engine]: values[0]} if values else {}
    if engine in ("chrono", "lammps", "simbody", "yade"):
        options["radius"] = 0.1
    law, contact = jc.ExactRestitution(e=0.5), jc.Contact(1.0, 1.4e8)
    found = export(law, contact, 4.2, engine=engine, **options)
    assert all(name.strip() in found.parameters for name in row[2].replace("`", "").split(","))
    if found.time_step is None:
        assert (row[3], row[4], row[5]) == ("", "not run", "")
    else:
        steps = round(found.duration / found.time_step)
        assert (row[3], row[5]) == (str(steps), f"{100 * found.expected_error:.1f} %")
        assert abs(float(row[4]) / 0.5 - 1) < found.expected_error


def test_every_engine_is_in_the_table():
    assert {variant(row)[0] for row in rows()} == set(engines())
    assert len(rows()) >= 17

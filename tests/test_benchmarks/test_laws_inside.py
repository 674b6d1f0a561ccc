"""Laws inside MJX and JaxSim: the stored result and its page."""

import json

from benchmarks import laws_inside

FOUND = json.loads(laws_inside.RESULT.read_text())
ERRORS = {"ours, for an error of 1 %": 0.01, "ours, for 0.1 %": 1e-3}
ERRORS["ours, for 1 %, 8 substeps"] = 0.01


def test_the_page_has_the_tables():
    page = (laws_inside.ROOT / "docs" / "engines.md").read_text(encoding="utf-8")
    assert laws_inside.engines() in page
    assert laws_inside.table(FOUND) in page
    versions = ", ".join(f"{name} {number}" for name, number in FOUND["versions"].items())
    assert versions in page


def test_ours_keeps_what_it_promises():
    for row in FOUND["rows"]:
        for cell in row["e"]:
            if row["contact"] in ERRORS:
                worst = max(abs(cell[end] / cell["asked"] - 1) for end in ("low", "high"))
                assert worst < ERRORS[row["contact"]]

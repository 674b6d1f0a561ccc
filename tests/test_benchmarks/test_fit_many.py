"""Many balls at once: the stored result, and its page."""

import json

from benchmarks import fit_many

NEAR = 1e-6
"""Largest difference from `jc.fit`, in standard errors: measured 6e-7."""


def result():
    return json.loads(fit_many.RESULT.read_text())


def test_the_page_has_the_table():
    page = (fit_many.ROOT / "docs" / "calibrate.md").read_text(encoding="utf-8")
    assert fit_many.table(result()) in page


def test_a_thousand_balls_are_as_fitted_alone():
    known = result()
    assert known["balls"] == 1000 and known["away"] < NEAR
    # Of 95 % intervals of normal errors, for a curve: a thousand draws scatter by 0.7 %.
    assert all(0.92 < held < 0.97 for held in known["held"].values())

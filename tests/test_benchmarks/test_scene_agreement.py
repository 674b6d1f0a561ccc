"""Exported scenes beside `simulate`: the stored result and its page."""

import json

import numpy as np
import pytest

from benchmarks import scene_agreement


@pytest.fixture(scope="module")
def found():
    return json.loads(scene_agreement.RESULT.read_text())


def test_the_page_has_the_tables(found):
    page = (scene_agreement.ROOT / "docs" / "export.md").read_text()
    assert scene_agreement.tables(found) in page
    assert scene_agreement.oblique_table(found) in page


def test_every_case_was_run(found):
    rows = [(row["engine"], row["scene"]) for row in found["rows"]]
    assert rows == [(engine, make.__name__) for engine, make in scene_agreement.CASES]


def test_the_engines_agree_up_to_the_margin_of_the_run(found):
    for row in found["rows"]:
        # An error of e in every impact, amplified as the run amplifies a change.
        bound = row["growth"] * row["expected_error"] * row["closing"]
        assert row["velocity"] < bound
        assert row["time"] < row["margin"]
        assert row["expected_error"] < found["tolerance"] * (1 + 1e-6)


def test_a_missed_tolerance_is_missed_as_stated(found):
    for row in found["missed"].values():
        assert 0.5 < np.abs(row["errors"]).max() / row["expected_error"] < 1.02


def test_hard_contacts_rebound_as_rigid_ones(found):
    names = [(row["engine"], row["name"]) for row in found["oblique"]]
    laws, impacts = scene_agreement.LAWS, scene_agreement.OBLIQUE
    assert names == [(engine, name) for engine in laws for name in impacts]
    for row in found["oblique"]:
        for name in ("slip", "spin"):
            # Below the error of e, or smaller in the shorter contact in proportion to its duration.
            shorter = row["hard"]["duration"] / row["soft"]["duration"]
            assert row["hard"][name] < max(found["tolerance"], 1.5 * shorter * row["soft"][name])
        assert row["hard"]["normal"] < 1.1 * found["tolerance"]

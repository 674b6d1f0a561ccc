"""`jaxcontact laws`: every law, and the restitution it delivers."""

import json

import numpy as np
import pytest

from jaxcontact._laws import list_laws
from jaxcontact.lab.cli import main
from jaxcontact.lab.cli.commands.laws import table

# Delivered e for e = .9 .7 .5 .3 .1, to four decimals, from the energy balance in 40 digits.
PUBLISHED = {
    "hunt_crossley": (0.9090, 0.7680, 0.6630, 0.5813, 0.5158),
    "lankarani_nikravesh": (0.9132, 0.7960, 0.7252, 0.6842, 0.6653),
    "flores": (0.8939, 0.6832, 0.4704, 0.2562, 0.0694),
    "hu_guo": (0.8999, 0.6973, 0.4877, 0.2707, 0.0741),
    "gonthier": (0.8764, 0.6696, 0.4877, 0.3042, 0.1010),
    "carvalho_martins": (0.9000, 0.7000, 0.5002, 0.3040, 0.1289),
    "exact": (0.9, 0.7, 0.5, 0.3, 0.1),
}

FOUR_DECIMALS = 5.1e-5

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
    for law, numbers in PUBLISHED.items():
        np.testing.assert_allclose(delivered[law], numbers, atol=FOUR_DECIMALS, err_msg=law)


def test_the_text_and_the_json(rows, capsys):
    assert main(["laws", "--quiet"]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
    for text in ("3(1-e)/(2e)", "0.8999", "0.6973", "0.4877", "0.2707", "0.0741", "Hu & Guo 2015"):
        assert text in lines["hu_guo"]
    assert lines["hertz"].split().count("-") == 5
    assert main(["laws", "--json", "--quiet"]) == 0
    assert json.loads(capsys.readouterr().out) == list(rows.values())

"""`jaxcontact paper`."""

import csv
import json

import numpy as np
import pytest

from jaxcontact import paper
from jaxcontact._cli import main


def test_one_figure(tmp_path, capsys):
    folder = tmp_path / "new" / "folder"
    # Without --json the output is numbers.md.
    assert main(["paper", "--quiet", "--json", "--out", str(folder), "fig6"]) == 0
    table = paper.markdown(paper.numbers())
    told = json.loads(capsys.readouterr().out)
    assert [(one["name"], one["ours"]) for one in told] == [
        (number.published.name, number.ours) for number in paper.numbers()
    ]
    assert (folder / "numbers.md").read_text() == table
    assert (folder / "fig6.png").read_bytes().startswith(b"\x89PNG")
    tables = paper.fig6().tables
    assert {path.name for path in folder.iterdir()} == {"fig6.png", "numbers.md"} | {
        f"fig6_{name}.csv" for name in tables
    }
    with open(folder / "fig6_restitution.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    written = np.array([float(row["hu_guo"]) for row in rows])
    np.testing.assert_array_equal(written, tables["restitution"]["hu_guo"])


def test_every_figure_has_its_name():
    assert list(paper.FIGURES)[:7] == ["fig3", "fig4", "fig5", "fig6", "fig8", "fig9", "fig10"]
    for name, figure in paper.FIGURES.items():
        assert getattr(paper, name) is figure


@pytest.mark.parametrize("arguments", [["fig7"], ["--out", "{file}", "fig6"]])
def test_bad_arguments(tmp_path, capsys, arguments):
    file = tmp_path / "file"
    file.write_text("mine")
    assert main(["paper", *(word.format(file=file) for word in arguments)]) == 2
    assert "error: " in capsys.readouterr().err
    assert file.read_text() == "mine" and list(tmp_path.iterdir()) == [file]

"""A short form of the study of how often a model is called inadequate."""

import json
from pathlib import Path

import pytest

from benchmarks.fit_adequacy import main, printed

PAGE = Path(__file__).parents[2] / "docs" / "trust.md"


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    main(["--draws", "1", "--into", str(folder)])
    main(["--page", "--into", str(folder)])
    return folder


def test_every_cell_is_there(results):
    found = json.loads((results / "fit_adequacy.json").read_text())
    assert set(found["levels"]["unknown"]) == {"8", "25", "200", "2000"}
    assert len(found["power"]) == 7 and len(found["curves"]) == 4
    assert all(share in (0, 1) for row in found["power"] for share in row["shares"].values())


def test_the_page_is_whole(results):
    page = (results / "trust.md").read_text()
    assert "{" not in page.split("```")[-1]
    ours = PAGE.read_text()
    assert [line for line in page.splitlines() if line.startswith("#")] == [
        line for line in ours.splitlines() if line.startswith("#")
    ]


def test_the_example_prints_what_the_page_says():
    _, code, _, said, _ = PAGE.read_text().split("```")
    got = printed(code.removeprefix("python\n")).splitlines()
    want = said.removeprefix("text\n").rstrip().splitlines()
    assert got[0] == want[0]
    assert [line.split()[0] for line in got] == [line.split()[0] for line in want]

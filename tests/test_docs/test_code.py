"""The pages: their code prints the output shown, commands are valid, the reference is whole."""

import json
import math
import re
import shlex
from collections import Counter

import pytest

import jaxcontact as jc
from docs.quoted import MARK, ROOT, numbers, written
from docs.quoted import pages as quoting
from docs.run_code import DOCS, digits, pages, run
from jaxcontact import extend
from jaxcontact._laws import registry as _registry
from jaxcontact.lab.cli import _parser, main

# The promotion of readers, not the strict one of the tests.
pytestmark = pytest.mark.usefixtures("usual_promotion")

# Pages whose code is run elsewhere: one has its own test, one is run by the script of its plots.
ELSEWHERE = {"sweeps.md": "tests/test_sweep/test_store.py", "plots.md": "docs/plots.py"}
README = DOCS.parent / "README.md"
PAGES = [page for page in pages() if page.name not in ELSEWHERE]


@pytest.mark.slow(reason="the code of a whole page; runs with the site")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_the_code_prints_what_the_page_shows(page, monkeypatch):
    monkeypatch.setattr(_registry, "_REGISTRY", dict(_registry._REGISTRY))
    for block, printed in run(page):
        if block.shown is not None:
            assert digits(printed) == digits(block.shown), f"line {block.line}"


TABLE = re.compile(
    r"^```csv\n(?P<table>.*?)^```$\n\n"
    r"^```bash\n(?P<command>jaxcontact [^\n]*)\n```$\n\n"
    r"^```text\n(?P<shown>.*?)^```$",
    re.DOTALL | re.MULTILINE,
)


@pytest.mark.slow(reason="fits three friction laws; test_calibration/test_oblique.py is quicker")
def test_the_command_prints_what_the_page_shows(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    found = list(TABLE.finditer((DOCS / "commands.md").read_text(encoding="utf-8")))
    assert found
    for one in found:
        _, *arguments = shlex.split(one["command"])
        (tmp_path / arguments[1]).write_text(one["table"], encoding="utf-8")
        assert main(arguments) == 0
        assert digits(capsys.readouterr().out) == digits(one["shown"])


def commands():
    """The lines that begin with `jaxcontact`, continued ones joined, with the page of each."""
    for page in [*sorted(DOCS.rglob("*.md")), README]:
        for block in re.findall(r"```bash\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
            for line in block.replace("\\\n", "").splitlines():
                if line.strip().startswith("jaxcontact "):
                    yield page.name, re.split(r" > | && ", line.strip())[0]


def test_the_commands_are_understood():
    found = list(commands())
    assert len(found) > 10
    for page, command in found:
        arguments = shlex.split(command, comments=True)[1:]
        if arguments[0] != "--completion":
            assert _parser().parse_args(arguments).command, f"{page}: {command}"


def test_the_code_prints_what_the_readme_says():
    ((block, printed),) = run(README)
    assert block.shown is not None
    assert digits(printed) == digits(block.shown)


def test_what_the_readme_links_to_is_there_and_its_commands_are_one_line_each():
    text = README.read_text(encoding="utf-8")
    for name in ("main", "test"):
        pattern = rf"<!-- command: {name} -->\n```bash\n(.*?)```"
        (command,) = re.findall(pattern, text, re.DOTALL)
        assert command.count("\n") == 1
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        if not target.startswith("http"):
            assert (README.parent / target).exists(), target


# Every public name is on one page of the reference, with an example; quoted numbers.

ENTRY = re.compile(r"^::: jaxcontact\.([\w.]+)$", re.MULTILINE)
CODE = re.compile(r"^```(?:python|text)\n(.*?)^```", re.DOTALL | re.MULTILINE)


def entries() -> dict[str, list[str]]:
    """By name: the examples that follow its entry, one for each entry there is.

    Names one below the other share the examples below them.
    """
    found: dict[str, list[str]] = {}
    for page in DOCS.rglob("*.md"):
        text = page.read_text(encoding="utf-8")
        parts = ENTRY.split(text)
        waiting: list[str] = []
        for name, after in zip(parts[1::2], parts[2::2], strict=True):
            waiting.append(name)
            if examples := CODE.findall(after):
                for one in waiting:
                    found.setdefault(one, []).append("\n".join(examples))
                waiting = []
        for one in waiting:
            found.setdefault(one, []).append("")
    return found


def names_of(*modules: str) -> set[str]:
    places = [(module, name) for module in modules for name in dir(getattr(jc, module))]
    return {f"{module}.{name}" for module, name in places if not name.startswith("_")}


READY_MADE = names_of("jaxsim", "mjx", "systems")


def test_every_public_name_is_on_one_page_with_an_example():
    found = entries()
    assert {name for name in found if len(found[name]) > 1} == set()
    assert {*jc.__all__, *names_of("plot"), *READY_MADE} == set(found)
    # One page of pictures has one of each.
    lacking = [
        name
        for name in (*jc.__all__, *READY_MADE)
        if not re.search(rf"\b{name}\b", found[name][0]) and name not in IN_FULL
    ]
    assert lacking == []


# Their example is above, in full: a user's own class.
IN_FULL = {"AbstractLaw", "AbstractHuntCrossley", "AbstractForm", "ScaledImpact"} | {
    "AbstractElasticPlastic",
    "AbstractMethod",
    "register_law",
}


def test_what_is_written_in_full_is_and_every_name_of_extend_is_told():
    text = (DOCS / "extend.md").read_text(encoding="utf-8")
    assert all(f"jc.{name}" in text for name in IN_FULL)
    assert [name for name in extend.__all__ if f"`{name}`" not in text] == []


# Quoted numbers.


@pytest.fixture(scope="module")
def known():
    return numbers()


def quoted():
    """Every quoted number: its name, the page, and what stands there."""
    for page in quoting():
        for mark in MARK.finditer(page.read_text(encoding="utf-8")):
            yield mark["name"], page.name, mark["text"]


def test_every_page_says_what_the_result_says(known):
    for page in quoting():
        text = page.read_text(encoding="utf-8")
        assert written(text, known) == text, f"{page.name}: run python docs/quoted.py"
    counts = Counter(name for name, *_ in quoted())
    assert set(counts) == set(known)
    # The pages for which the rule was introduced.
    assert all(counts[name] >= 2 for name in ("laws", "numba_times_alone", "event_times_diffrax"))


def test_a_number_that_changes_is_seen_and_an_unknown_one_refused(known):
    text = f"about <!--laws-->{known['laws']}<!--/--> laws"
    assert written(text, known) == text
    assert written(text, known | {"laws": "five"}) == "about <!--laws-->five<!--/--> laws"
    with pytest.raises(KeyError):
        written("<!--nobody-->5<!--/-->", known)


def test_the_page_that_is_made_of_the_same_results_says_the_same(known):
    """docs/trust.md is written from its template by benchmarks/fit_adequacy.py."""
    trust = (ROOT / "docs" / "trust.md").read_text(encoding="utf-8")
    total = re.search(r"^\| all \| (\d+) \| ([\d.]+) \|", trust, re.MULTILINE)
    assert total is not None
    assert known["choice_tables"] == f"{int(total[1]):,}"
    assert known["sure_and_wrong"] == f"{total[2]} %"
    # In bold where it misses its target.
    assert f" {known['worst_sure_and_wrong'].removesuffix(' %')} |" in trust.replace("**", "")
    assert f"**{known['least_held'].removesuffix(' %')}**" in trust


def rounded(ratio):
    """A ratio is quoted with two digits, so that its last one may be half a unit off."""
    return pytest.approx(ratio, abs=0.5001 * 10 ** (math.floor(math.log10(ratio)) - 1))


def test_ratios_are_those_of_the_rows(known):
    """Counted anew, without the code of the pages."""
    rows = json.loads((ROOT / "benchmarks" / "run_time_error.json").read_text())["rows"].values()
    best = {}
    for row in rows:
        if row["group"] == "impacts" and row["batch"] == 100_000 and row.get("error", 1) <= 1e-9:
            for who in (row["family"], row["way"]):
                key = row["problem"], who
                best[key] = min(best.get(key, float("inf")), row["cost"])
    ratio = best["hunt_crossley", "numba"] / best["hunt_crossley", "exact"]
    assert float(known["hunt_crossley_times_numba"]) == rounded(ratio)
    least, most = map(float, known["event_times_diffrax"].split(" to "))
    ratios = [best[p, "diffrax"] / best[p, "event"] for p in ("own", "pushed")]
    assert (least, most) == (rounded(min(ratios)), rounded(max(ratios)))

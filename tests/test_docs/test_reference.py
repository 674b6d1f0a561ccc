"""Every public name is on one page of the reference, with an example that runs.

Numbers quoted in pages equal those of the results they come from.
"""

import json
import math
import re
from collections import Counter

import pytest

import jaxcontact as jc
from docs.quoted import MARK, ROOT, numbers, pages, written
from docs.run_code import DOCS
from jaxcontact import extend

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


def test_every_public_name_is_on_one_page():
    found = entries()
    assert {name for name in found if len(found[name]) > 1} == set()
    assert {*jc.__all__, *names_of("plot"), *READY_MADE} == set(found)


def test_every_public_name_has_an_example():
    found = entries()
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


def test_what_is_written_in_full_is():
    text = (DOCS / "extend.md").read_text(encoding="utf-8")
    assert all(f"jc.{name}" in text for name in IN_FULL)


def test_every_name_of_extend_is_told():
    text = (DOCS / "extend.md").read_text(encoding="utf-8")
    assert [name for name in extend.__all__ if f"`{name}`" not in text] == []


# Quoted numbers.


@pytest.fixture(scope="module")
def known():
    return numbers()


def quoted():
    """Every quoted number: its name, the page, and what stands there."""
    for page in pages():
        for mark in MARK.finditer(page.read_text(encoding="utf-8")):
            yield mark["name"], page.name, mark["text"]


def test_every_page_says_what_the_result_says(known):
    for page in pages():
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

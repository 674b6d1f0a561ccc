"""Every public name is on one page of the reference, with an example that runs."""

import re

import jaxcontact as jc
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

"""The code of the pages and of the README runs and prints the output shown; commands are valid."""

import re
import shlex

import pytest

from docs.run_code import DOCS, digits, pages, run
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


@pytest.mark.parametrize("name", ["main", "test"])
def test_the_commands_are_one_line_each(name):
    text = README.read_text(encoding="utf-8")
    found = re.findall(rf"<!-- command: {name} -->\n```bash\n(.*?)```", text, re.DOTALL)
    assert len(found) == 1
    assert found[0].count("\n") == 1


def test_what_the_readme_links_to_is_there():
    for target in re.findall(r"\]\(([^)#]+)\)", README.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (README.parent / target).exists(), target

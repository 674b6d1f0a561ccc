"""The README's code runs, and prints the output shown."""

import re

import jax
import pytest

from docs.run_code import DOCS, digits, run

README = DOCS.parent / "README.md"


def test_the_code_prints_what_the_readme_says():
    # The type promotion of readers, not the strict one of the tests.
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
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

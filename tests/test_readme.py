"""The README's code runs, and prints what the README says it prints."""

import contextlib
import io
import re
from pathlib import Path

import jax
import pytest

from jaxcontact._laws import _registry

README = Path(__file__).parents[1] / "README.md"
PAIR = re.compile(r"```python\n((?:(?!```).)*)```\n\n```text\n(.*?)```", re.DOTALL)
SCENE = re.compile(r"```python\n(balls = (?:(?!```).)*)```", re.DOTALL)


def blocks() -> list[tuple[str, str]]:
    return PAIR.findall(README.read_text(encoding="utf-8"))


def digits(text: str) -> str:
    """The text with its numbers at six digits: a derivative of an event solve has seven."""
    return re.sub(r"-?\d+\.\d+(e[-+]?\d+)?", lambda m: f"{float(m[0]):.6g}", text)


def run(codes: list[str]) -> list[str]:
    printed, names = [], {}
    # The promotion that readers have, not the strict one of the tests.
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        for code in codes:
            with contextlib.redirect_stdout(io.StringIO()) as out:
                exec(code, names)
            printed.append(out.getvalue())
    return printed


def test_the_code_prints_what_the_readme_says():
    pairs = blocks()
    assert len(pairs) == 2
    try:
        printed = run([code for code, _ in pairs])
    finally:
        _registry._REGISTRY.pop("my_law", None)
    for (_, said), real in zip(pairs, printed, strict=True):
        assert digits(real) == digits(said)


def test_the_scene_runs_and_is_drawn():
    """Out of time, which compiles in seconds."""
    (code,) = SCENE.findall(README.read_text(encoding="utf-8"))
    assert code.count("duration=1.2)") == 1
    code = code.replace("duration=1.2)", "duration=1.2, instantaneous=True)")
    (printed,) = run(["import jaxcontact as jc\n" + code])
    assert "right - bowl" in printed


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

"""The prose linter finds planted examples of each rule and passes clean text."""

import importlib.util
from pathlib import Path

import pytest

PLACE = Path(__file__).parents[2] / ".ci" / "prose.py"
LONG = "The law " + "and the contact " * 10 + "meet."

PLANTED = {
    "opens with Who": "Who names a test wants it.",
    "opens with What ... is": "What is misspelt is a name.",
    "opens with Whether": "Whether the law pulls.", "opens with That of": "That of the law stays.",
    "is none": "The other one is none.", "is told": "The user is told.",
    "knows": "The law knows its contact.", "more than 30 words": LONG,
}  # fmt: skip

CLEAN = '''"""Return the restitution of a law, in (0, 1]; None if there is none.

Arguments: a law with its contact; the closing speed in m/s, positive; the exponent of the contact,
between 1 and 3; the tolerance of the solve; the number of steps; and the `axes` of the plot.
Source: Hunt & Crossley (1975), Coefficient of restitution interpreted as damping in vibroimpact, in
the Journal of Applied Mechanics, a journal of the American Society of Mechanical Engineers, 42.
"""

n = 3  # a length
'''

PAGE = """# Who reads headings

| Who | reads tables |
|---|---|

```python
# Who reads code
```

<!-- table of a study -->
Who reads results knows the study.
<!-- end of table -->

The [page](https://example.org/knows) opens with its subject.
"""


@pytest.fixture
def prose():
    spec = importlib.util.spec_from_file_location("prose", PLACE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("rule", PLANTED)
def test_a_planted_sentence_is_found(prose, tmp_path, capsys, rule):
    sentence = PLANTED[rule]
    texts = {
        "docstring.py": f'def f():\n    """Return a law.\n\n    It pulls. {sentence}\n    """\n',
        "comment.py": f"n = 1\n# It pulls.\n\n\n# {sentence}\n",
        "raised.py": f'raise ValueError(f"Argument {{n}}. {sentence}")\n',
        "help.py": f'EPILOG = """It pulls.\n\n{sentence}\n"""\nadd("--n", help="{sentence}")\n',
        "page.md": f"# A page\n\nIt pulls.\n\n- An item. {sentence}\n",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    assert prose.main([str(tmp_path)]) == 1
    lines = capsys.readouterr().out.splitlines()
    planted = ("comment.py", 5), ("docstring.py", 4), ("help.py", 3), ("help.py", 5), ("page.md", 5)
    for name, line in (*planted, ("raised.py", 1)):
        assert f"{tmp_path / name}:{line}: {rule}: {sentence}" in lines
    assert lines[-1] == f"{tmp_path}: 6 findings, 0 allowed"


def test_clean_text_passes(prose, tmp_path, capsys):
    (tmp_path / "clean.py").write_text(CLEAN, encoding="utf-8")
    (tmp_path / "page.md").write_text(PAGE, encoding="utf-8")
    assert prose.main([str(tmp_path), "--all"]) == 0
    assert capsys.readouterr().out == ""


def test_a_folder_may_hold_what_it_is_allowed(prose, tmp_path, monkeypatch, capsys):
    page = tmp_path / "page.md"
    page.write_text("Who knows.\n\nIt is told.\n", encoding="utf-8")
    monkeypatch.setitem(prose.ALLOWED, tmp_path.as_posix(), 2)
    assert prose.main([str(page)]) == 0 and capsys.readouterr().out == ""
    assert prose.main([str(page), "--count"]) == 0
    assert capsys.readouterr().out == f"{tmp_path}: 2 findings, 2 allowed\n"
    page.write_text("Who knows.\n\nIt is told.\n\nThe law knows.\n", encoding="utf-8")
    assert prose.main([str(page)]) == 1
    assert "page.md:5: knows: The law knows." in capsys.readouterr().out

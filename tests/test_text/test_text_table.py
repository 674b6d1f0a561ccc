"""Tables and wrapped text, character by character."""

from jaxcontact._text.table import markdown_table, text_table, wrapped


def test_columns_are_as_wide_as_their_widest_cell():
    rows = [("a", "1.5", ""), ("longer", "10.25", "note")]
    assert text_table(rows, header=("", "number"), align="<>", indent=2, rule=True) == [
        "          number",
        "  --------------------",
        "  a          1.5",
        "  longer   10.25  note",
    ]
    assert text_table([("a", "b"), ("cc", "d")], gap=1) == ["a  b", "cc d"]
    assert text_table([]) == []


def test_markdown():
    assert markdown_table(("name", ""), [("x", "1"), ("y", "")]) == [
        "| name | |",
        "|---|---|",
        "| x | 1 |",
        "| y | |",
    ]


def test_wrapped_text():
    lines = wrapped("fields", "one-two three four", width=20, indent=8, lead="  ")
    assert lines == ["  fields one-two", "        three four"]
    assert wrapped("Pairs", "many") == ["Pairs      many"]
    assert wrapped("Pairs", "") == []

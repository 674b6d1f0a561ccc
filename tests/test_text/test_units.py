"""Tables and wrapped text, character by character; words and units of labels."""

import dataclasses

import pytest

import jaxcontact as jc
from jaxcontact._text.units import label, meaning, quantity
from jaxcontact._text.words import text_table, wrapped

# Self-explanatory names, and names that are not quantities.
PLAIN = {"restitution", "status", "method", "solver"}


@pytest.mark.parametrize("result", [jc.Impact, jc.Bounce])
def test_all_that_a_result_holds_has_words(result):
    names = {field.name for field in dataclasses.fields(result)}
    assert {name for name in names if meaning(name) == (name, "")} <= PLAIN


@pytest.mark.parametrize(
    ("names", "text"),
    [
        (["v", "v0", "velocity", "impact_velocity"], "closing speed / (m/s)"),
        (["m", "mass"], "effective mass / kg"),
        (["K", "stiffness"], "contact stiffness / (N/m^n)"),
        (["n", "exponent"], "exponent n"),
        (["R", "radius"], "radius / m"),
        (["unheard_of"], "unheard_of"),
    ],
)
def test_labels(names, text):
    assert [label(name) for name in names] == [text] * len(names)


def test_other_words_a_prefix_and_a_number():
    assert label("duration", "contact", prefix="m") == "contact / ms"
    assert label("v", prefix="k") == "closing speed / (km/s)"
    assert quantity("velocity", "4.2") == "4.2 m/s" and quantity("e", "0.5") == "0.5"


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


def test_wrapped_text():
    lines = wrapped("fields", "one-two three four", width=20, indent=8, lead="  ")
    assert lines == ["  fields one-two", "        three four"]
    assert wrapped("Pairs", "many") == ["Pairs      many"]
    assert wrapped("Pairs", "") == []

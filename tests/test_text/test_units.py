"""Words and units of labels: all quantities of a result, and the forms of a label."""

import dataclasses

import pytest

import jaxcontact as jc
from jaxcontact._text.units import label, meaning, quantity

# Self-explanatory names, and names that are not quantities.
PLAIN = {"restitution", "status", "method"}


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

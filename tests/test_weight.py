"""The weight of first calls, in instructions and programs, stays within its budgets."""

import pytest

from benchmarks.weight import BUDGETS, CALLS, MARGIN, PROGRAMS, counted_here, weight

LARGE = ("scene", "bounce with", "fit_record")
"""Half a minute of tracing and compiling, in a process of its own."""


def cases():
    for name in BUDGETS:
        marks = [pytest.mark.slow] if any(word in name for word in LARGE) else []
        yield pytest.param(name, marks=marks, id=name)


def test_every_call_has_a_budget():
    assert set(BUDGETS) == set(CALLS)


@pytest.mark.skipif(not counted_here(), reason="budgets are counted at other versions")
@pytest.mark.parametrize("name", list(cases()))
def test_a_first_call_keeps_its_budget(name):
    budget, found = BUDGETS[name], weight(PROGRAMS[name])
    assert found["instructions"] <= MARGIN * budget.instructions, found
    assert found["programs"] <= MARGIN * budget.programs, found

"""The weight of first calls, in instructions and programs, stays within its budgets."""

import pytest

from benchmarks.weight import BUDGETS, CALLS, MARGIN, PROGRAMS, counted_here, imported, weight


def test_every_call_has_a_budget():
    assert set(BUDGETS) == set(CALLS)


@pytest.fixture(scope="module")
def run():
    with imported() as run_copy:
        yield run_copy


@pytest.mark.slow(
    "soft scene of 2 discs and a plane: gradient",
    reason="half a minute of tracing and compiling",
)
@pytest.mark.skipif(not counted_here(), reason="budgets are counted at other versions")
@pytest.mark.parametrize("name", BUDGETS)
def test_a_first_call_keeps_its_budget(name, run):
    budget, found = BUDGETS[name], weight(PROGRAMS[name], run)
    assert found["instructions"] <= MARGIN * budget.instructions, found
    assert found["programs"] <= MARGIN * budget.programs, found

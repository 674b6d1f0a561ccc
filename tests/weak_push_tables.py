"""The stored tables of weak pushes: `python -m tests.weak_push_tables` regenerates them."""

from __future__ import annotations

import json
from pathlib import Path

from jaxcontact._forms.weak_push.correction import FILE as NAME
from jaxcontact._forms.weak_push.correction import Table, computed, name_of

FILE = Path(__file__).parents[1] / "jaxcontact" / "_forms" / "weak_push" / NAME

STORED = ((1.0, 1), (1.5, 2))
"""The exponents n, and the k of x = w^k that the Hunt-Crossley form takes for them."""

DIGITS = 12
"""The integration leaves 1e-10."""


def rows(table: Table) -> list:
    numbers = [[float(f"{x:.{DIGITS}g}") for x in row] for row in table.coefficients]
    return [numbers, table.output.tolist(), table.powers.tolist()]


if __name__ == "__main__":
    tables = {name_of(*key): rows(computed(*key)) for key in STORED}
    FILE.write_text(json.dumps(tables, separators=(",", ":")) + "\n")

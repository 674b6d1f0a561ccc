"""`jaxcontact laws`: all laws, and the restitution that each delivers."""

from __future__ import annotations

import argparse
import math
from typing import Any

from ....extend import Stages, text_table
from ..options import Output

ASKED = (0.9, 0.7, 0.5, 0.3, 0.1)

SUMMARY = "table of all laws and what they deliver"

DESCRIPTION = """\
A table of all laws: name, α(e) of F = K δⁿ (1 + α δ'/v0) (or the force, for laws of another form),
the restitution of a free impact for e = 0.9 0.7 0.5 0.3 0.1, and the source. A dash: the law has no
parameter e (its restitution follows from its own parameters, and often from the speed).
"""

EPILOG = """\
exit codes: 0 done; 2 bad input.
"""

OPTIONS = ""


def run(arguments: argparse.Namespace, progress: Stages) -> Output:
    """Return the table."""
    progress("compiling and solving an impact for each law and e")
    rows = table()
    header = ("law", "α(e), or the force", *(f"e = {e:g}" for e in ASKED), "source")
    cells = []
    for row in rows:
        delivered = row["delivers"] or {}
        numbers = [delivered.get(f"{e:g}") for e in ASKED]
        shown = ("-" if e is None else f"{e:.4f}" for e in numbers)
        cells.append((row["law"], row["formula"], *shown, row["source"]))
    return Output(text_table(cells, header=header, rule=True), rows)


def table() -> list[dict[str, Any]]:
    """Return rows of `law`, `formula`, `source`, `valid`, `delivers` ({e: e_out} or None)."""
    import jax.numpy as jnp

    from .... import list_laws
    from ....extend import constant_laws, describe, restitutions

    names = constant_laws()
    classes = tuple(describe(name).cls for name in names)
    rows = restitutions(classes, jnp.tile(jnp.array(ASKED), (len(names), 1)))
    delivered = {
        name: {
            f"{e:g}": out if math.isfinite(out) else None
            for e, out in zip(ASKED, row.tolist(), strict=True)
        }
        for name, row in zip(names, rows, strict=True)
        if row is not None
    }
    return [
        {
            "law": law.name,
            "formula": law.formula,
            "source": law.source,
            "valid": law.valid,
            "delivers": delivered.get(law.name),
        }
        for law in map(describe, list_laws())
    ]

"""`jaxcontact laws`: all laws, and the restitution that each delivers."""

from __future__ import annotations

import argparse
import json
import math
import sys
from typing import Any

from .._progress import Stages
from .._text_table import text_table
from ._parser import add_command

ASKED = (0.9, 0.7, 0.5, 0.3, 0.1)

_DESCRIPTION = """\
A table of all laws: name, α(e) of F = K δⁿ (1 + α δ'/v0) (or the force, for laws of another form),
the restitution of a free impact for e = 0.9 0.7 0.5 0.3 0.1, and the source. A dash: the law has no
parameter e (its restitution follows from its own parameters, and often from the speed).
"""


def add_parser(commands: Any) -> None:
    """Add `laws` to the subparsers of argparse."""
    summary = "table of all laws and what they deliver"
    parser = add_command(commands, run, "laws", summary, _DESCRIPTION)
    parser.add_argument("--json", action="store_true", help="as JSON instead of a table")


def run(arguments: argparse.Namespace) -> int:
    """Print the table."""
    progress = Stages(quiet=arguments.quiet)
    progress("compiling and solving an impact for each law and e")
    rows = table()
    if arguments.json:
        json.dump(rows, sys.stdout, indent=1, ensure_ascii=False, allow_nan=False)
        print()
    else:
        print(_text(rows))
    return 0


def table() -> list[dict[str, Any]]:
    """One row per law: `law`, `formula`, `source`, `valid`, `delivers` ({e: e_out}, or None)."""
    from .._laws import constant_laws, describe, list_laws

    delivered = _delivered(constant_laws())
    rows = []
    for name in list_laws():
        words = describe(name)
        rows.append(
            {
                "law": name,
                "formula": words.formula,
                "source": words.source,
                "valid": words.valid,
                "delivers": delivered.get(name),
            }
        )
    return rows


def _delivered(names: list[str]) -> dict[str, dict[str, float | None]]:
    """What each law delivers for the e of `ASKED`; None where that is not finite."""
    import jax.numpy as jnp
    import numpy as np

    from .._contact import Contact
    from .._impact import restitution
    from .._laws import AbstractHuntCrossley, Damped, describe, get_law

    def table_row(e: np.ndarray) -> dict[str, float | None]:
        return {
            f"{asked:g}": float(out) if math.isfinite(out) else None
            for asked, out in zip(ASKED, e, strict=True)
        }

    asked = jnp.array(ASKED)
    family = [name for name in names if issubclass(describe(name).cls, AbstractHuntCrossley)]
    # α alone decides the restitution: all laws of the family are one batch, compiled once.
    contact = Contact(1.0, 1.0)
    alpha = jnp.stack([get_law(name, e=asked).damping_factor(contact, 1.0) for name in family])
    delivered = np.asarray(restitution(Damped(alpha=alpha), contact, 1.0))
    rows = {name: table_row(e) for name, e in zip(family, delivered, strict=True)}
    for name in names:
        if name not in rows:
            exponents = describe(name).cls.exponents
            own = Contact(1.0, 1.0, exponents[0]) if exponents else contact
            rows[name] = table_row(np.asarray(restitution(get_law(name, e=asked), own, 1.0)))
    return rows


def _text(rows: list[dict[str, Any]]) -> str:
    header = ("law", "α(e), or the force", *(f"e = {e:g}" for e in ASKED), "source")
    cells = []
    for row in rows:
        delivered = row["delivers"] or {}
        numbers = [delivered.get(f"{e:g}") for e in ASKED]
        told = ("-" if e is None else f"{e:.4f}" for e in numbers)
        cells.append((row["law"], row["formula"], *told, row["source"]))
    return "\n".join(text_table(cells, header=header, rule=True))

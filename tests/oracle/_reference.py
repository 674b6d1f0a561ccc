"""The stored answers, read as floats."""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

REFERENCE_FILE = Path(__file__).with_name("reference.json")


@dataclass(frozen=True)
class Case:
    """One stored impact: ``case.args["alpha"]``, ``case.value["e"]``, ``case.d["alpha"]["e"]``,
    ``case.d2[...]``.

    A derivative is None where none exists (a kink of that output). ``settled`` is true where a
    contact under gravity did not separate.
    """

    function: str
    args: dict[str, float | bool | str]
    value: dict[str, float]
    d: dict[str, dict[str, float | None]]
    d2: dict[str, dict[str, float | None]]
    settled: bool

    def __str__(self) -> str:
        return f"{self.function}({', '.join(f'{k}={v}' for k, v in self.args.items())})"


def _floats(names: list[str], numbers: list[str | None]) -> dict[str, float | None]:
    return {f: None if x is None else float(x) for f, x in zip(names, numbers, strict=True)}


@cache
def cases(function: str) -> tuple[Case, ...]:
    """All stored cases of an oracle function, in the order of the grid."""
    stored = json.loads(REFERENCE_FILE.read_text())
    names = stored["fields"]
    return tuple(
        Case(
            function=function,
            args={
                k: x if isinstance(x, bool) or k == "ending" else float(x)
                for k, x in row["args"].items()
            },
            value={f: float(x) for f, x in zip(names, row["value"], strict=True)},
            d={k: _floats(names, x) for k, x in row.get("d", {}).items()},
            d2={k: _floats(names, x) for k, x in row.get("d2", {}).items()},
            settled=row.get("settled", False),
        )
        for row in stored["cases"][function]
    )

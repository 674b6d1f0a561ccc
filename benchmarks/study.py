"""The command of a study of simulated recordings: its options, its result, and its table.

A study is in benchmarks/NAME.py, its result in benchmarks/NAME.json, and its table in docs/NAME.md
between two comments.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import platform
from collections.abc import Callable
from pathlib import Path

HERE = Path(__file__).parent


def machine() -> dict[str, str]:
    """Return the processor, the device and the versions of a result in float64."""
    import jax

    versions = {name: importlib.metadata.version(name) for name in ("jax", "diffrax")}
    device = str(jax.devices()[0].device_kind)
    return {"processor": platform.machine(), "device": device, **versions, "precision": "float64"}


def command(
    name: str,
    study: Callable[[int, int], dict],
    page: Callable[[dict], str],
    *,
    draws: int,
    others: int,
    title: str,
) -> None:
    """Draw what is simulated and write the result, or the table of an earlier one.

    `study` takes the number of draws, and that of each other kind; `page` makes the table.
    """
    written, text = HERE / f"{name}.json", HERE.parent / "docs" / f"{name}.md"
    parser = argparse.ArgumentParser(description=title)
    parser.add_argument("--only", type=int, help="so many draws, and write nothing")
    parser.add_argument("--page", action="store_true", help=f"write the table of docs/{name}.md")
    arguments = parser.parse_args()
    if arguments.page:
        begin, end = f"<!-- table of benchmarks/{name}.py -->", "<!-- end of table -->"
        before, _, rest = text.read_text().partition(begin)
        table = page(json.loads(written.read_text()))
        text.write_text(f"{before}{begin}\n{table}\n{end}{rest.partition(end)[2]}")
        return
    few = arguments.only
    found = study(few or draws, max(few // 10, 5) if few else others)
    result = json.dumps(found, indent=1) + "\n"
    print(result)
    if not few:
        written.write_text(result)

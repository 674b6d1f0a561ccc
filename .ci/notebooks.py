"""Executes notebooks afresh; the committed ones must show their outputs."""

import sys
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

CELL_TIMEOUT = 600  # seconds; a cell that hangs must not hang the whole run


def outputs(notebook: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    return [x for cell in notebook.cells if cell.cell_type == "code" for x in cell.outputs]


def complaint(path: Path) -> str | None:
    """Return the fault of a notebook, as committed or when executed; None if there is none."""
    notebook = nbformat.read(path, as_version=4)
    committed = outputs(notebook)
    if not committed:
        return "is committed without outputs"
    if any(x.output_type == "error" for x in committed):
        return "is committed with an error"
    if any(x.get("name") == "stderr" for x in committed):
        return "is committed with a progress bar or a warning on stderr"
    client = NotebookClient(
        notebook,
        timeout=CELL_TIMEOUT,
        kernel_name="python3",
        resources={"metadata": {"path": str(path.parent)}},
    )
    try:
        client.execute()
    except CellExecutionError as error:
        return f"fails:\n{error}"
    # A cell may be marked to continue after an exception; no cell should raise one.
    if any(x.output_type == "error" for x in outputs(notebook)):
        return "shows an error"
    return None


def main(paths: list[Path]) -> int:
    bad = 0
    for path in paths:
        start = time.perf_counter()
        wrong = complaint(path)
        bad += wrong is not None
        print(f"{path.name}: {wrong or f'{time.perf_counter() - start:.0f} s'}", flush=True)
    return min(bad, 1)


if __name__ == "__main__":
    sys.exit(main([Path(x) for x in sys.argv[1:]]))

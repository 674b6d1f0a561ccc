"""`python -m benchmarks NAME` runs a benchmark in float64."""

import importlib
import os
import sys
from pathlib import Path

import jax

if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    here = Path(__file__).parent
    files = {path.stem: path for path in here.rglob("*.py") if "\nSTUDY = " in path.read_text()}
    if sys.argv[1:2] not in [[name] for name in files]:
        sys.exit(f"usage: python -m benchmarks NAME, of {', '.join(sorted(files))}")
    name = ".".join(files[sys.argv[1]].relative_to(here).with_suffix("").parts)
    importlib.import_module(f"benchmarks.{name}").STUDY.command(sys.argv[2:])
    sys.stdout.flush()
    # A program that is still being compiled would keep the process.
    os._exit(0)

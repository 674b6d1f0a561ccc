"""`python -m benchmarks NAME` runs a benchmark in float64."""

import importlib
import os
import sys
from pathlib import Path

import jax

# Worker processes import this, too.
jax.config.update("jax_enable_x64", True)

if __name__ == "__main__":
    files = Path(__file__).parent.glob("*.py")
    names = sorted(path.stem for path in files if "\nSTUDY" in path.read_text())
    if sys.argv[1:2] not in [[name] for name in names]:
        sys.exit(f"usage: python -m benchmarks NAME, of {', '.join(names)}")
    importlib.import_module(f"benchmarks.{sys.argv[1]}").STUDY.command(sys.argv[2:])
    sys.stdout.flush()
    # A program that is still being compiled would keep the process.
    os._exit(0)

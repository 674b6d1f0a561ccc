"""Compiled programs, kept from one command to the next."""

from __future__ import annotations

import hashlib
import os
import platform
import warnings
from importlib.metadata import version
from pathlib import Path

VARIABLE = "JAXCONTACT_CACHE"
"""Names another folder; empty, nothing is kept. JAX's own variable wins over it."""

_STORE = "jax_compilation_cache_dir"


def keep_programs() -> None:
    """Let JAX store what it compiles where the user's programs keep such things, and find it there.

    What cannot be written or read is compiled as if there were no store, without a word.
    """
    import jax

    if getattr(jax.config, _STORE) is not None:
        return
    folder = _folder()
    if folder is None:
        return
    jax.config.update(_STORE, str(folder))
    # A command compiles many small programs: together they are the wait.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.02)
    for verb in ("reading", "writing"):
        warnings.filterwarnings("ignore", f"Error {verb} persistent compilation cache entry")


def users_folder() -> Path | None:
    """Where commands keep files for the user; None where they are told to keep none."""
    given = os.environ.get(VARIABLE)
    if given == "":
        return None
    if given is not None:
        return Path(given)
    import platformdirs

    return platformdirs.user_cache_path("jaxcontact")


def _folder() -> Path | None:
    """Where programs are kept for this processor and this JAX; None where nothing can be."""
    parent = users_folder()
    if parent is None:
        return None
    folder = parent / f"programs-{version('jaxlib')}-{_processor()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


def _processor() -> str:
    """Ten digits for what this processor can do: a home may be shared with others."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        about = next(line for line in lines if line.startswith(("flags", "Features")))
    except (OSError, StopIteration):
        about = platform.processor()
    return hashlib.sha256(f"{platform.machine()} {about}".encode()).hexdigest()[:10]

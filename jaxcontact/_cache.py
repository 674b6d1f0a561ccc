"""Compiled programs, kept from one process to the next."""

from __future__ import annotations

import hashlib
import os
import platform
from importlib.metadata import version
from pathlib import Path

VARIABLE = "JAXCONTACT_CACHE"
"""Names another folder; if empty, nothing is kept. JAX's own variable takes precedence."""

_STORE = "jax_compilation_cache_dir"


def cache(folder: str | os.PathLike[str] | None = None) -> Path | None:
    """Keep compiled programs on disk, so that the next process can read them.

    `folder` is the location; None uses the user's cache folder, as the commands do. The environment
    variable JAXCONTACT_CACHE names another one; if it is empty, nothing is kept. A folder that JAX
    already uses (`jax_compilation_cache_dir`) stays, unless `folder` is given.

    Programs are valid for one version of JAX and one kind of processor. They run as they are read:
    never use a folder to which others can write. Returns the folder, or None if none is used.
    Raises ValueError for a folder that cannot be written to. Source: JAX's persistent compilation
    cache.
    """
    # Imported here: the command line asks for the names in this file before it needs JAX.
    import jax
    from jax.experimental.compilation_cache import compilation_cache

    current = getattr(jax.config, _STORE)
    if folder is None:
        if current is not None:
            return Path(current)
        folder = users_folder()
        if folder is None:
            return None
    programs = _programs_in(folder)
    jax.config.update(_STORE, str(programs))
    # Many small programs are compiled, whose total compile time matters.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.02)
    # JAX looks for its store once, at the first program.
    compilation_cache.reset_cache()
    return programs


def users_folder() -> Path | None:
    """Return the folder for the user's cached files; None if nothing is to be kept."""
    chosen = os.environ.get(VARIABLE)
    if chosen == "":
        return None
    if chosen is not None:
        return Path(chosen)
    import platformdirs

    return platformdirs.user_cache_path("jaxcontact")


def _programs_in(parent: str | os.PathLike[str]) -> Path:
    """Return the folder in `parent` for this processor and this JAX."""
    try:
        folder = Path(parent) / f"programs-{version('jaxlib')}-{_processor()}"
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK)
    except (OSError, TypeError, ValueError):
        writable = False
    if not writable:
        from ._entry import refusal

        raise refusal("folder", "be a folder that can be written to", parent)
    return folder


def _processor() -> str:
    """Return ten digits that identify the processor's features; a home may be shared."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        about = next(line for line in lines if line.startswith(("flags", "Features")))
    except (OSError, StopIteration):
        about = platform.processor()
    return hashlib.sha256(f"{platform.machine()} {about}".encode()).hexdigest()[:10]

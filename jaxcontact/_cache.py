"""Compiled programs, kept from one process to the next."""

from __future__ import annotations

import hashlib
import os
import platform
from importlib.metadata import version
from pathlib import Path

VARIABLE = "JAXCONTACT_CACHE"
"""Names another folder; empty, nothing is kept. JAX's own variable wins over it."""

_STORE = "jax_compilation_cache_dir"


def cache(folder: str | os.PathLike[str] | None = None) -> Path | None:
    """Keep compiled programs on disk: the next process reads what this one has compiled.

    `folder`: where; None for the user's cache folder, which the commands use, too. The environment
    variable JAXCONTACT_CACHE names another one, and switches it off where it is empty. A folder
    that JAX keeps its programs in already (`jax_compilation_cache_dir`) stays, unless `folder` is
    given.

    Programs are kept for one version of JAX and one kind of processor. They run as they are read:
    name no folder that somebody else can write to. Returns the folder; None where none is used.
    Raises ValueError for a folder that cannot be written to. Source: JAX's persistent compilation
    cache.
    """
    # Loaded here: the command line asks for the names in this file before it needs JAX.
    import jax
    from jax.experimental.compilation_cache import compilation_cache

    own = getattr(jax.config, _STORE)
    if folder is None:
        if own is not None:
            return Path(own)
        folder = users_folder()
        if folder is None:
            return None
    programs = _made(folder)
    jax.config.update(_STORE, str(programs))
    # Many small programs are compiled: together they are the wait.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.02)
    # JAX looks for its store once, at the first program.
    compilation_cache.reset_cache()
    return programs


def users_folder() -> Path | None:
    """Where files are kept for the user; None where none are to be kept."""
    given = os.environ.get(VARIABLE)
    if given == "":
        return None
    if given is not None:
        return Path(given)
    import platformdirs

    return platformdirs.user_cache_path("jaxcontact")


def _made(parent: str | os.PathLike[str]) -> Path:
    """The folder in `parent` for this processor and this JAX."""
    try:
        folder = Path(parent) / f"programs-{version('jaxlib')}-{_processor()}"
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK)
    except (OSError, TypeError, ValueError):
        writable = False
    if not writable:
        from ._parameter import rendered

        raise ValueError(
            f"Argument `folder` must be a folder that can be written to, but is {rendered(parent)}."
        )
    return folder


def _processor() -> str:
    """Ten digits for what this processor can do: a home may be shared with others."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        about = next(line for line in lines if line.startswith(("flags", "Features")))
    except (OSError, StopIteration):
        about = platform.processor()
    return hashlib.sha256(f"{platform.machine()} {about}".encode()).hexdigest()[:10]

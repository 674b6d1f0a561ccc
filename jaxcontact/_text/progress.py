"""Progress on stderr: a bar for counted work, and a line for each stage of a command."""

from __future__ import annotations

import contextlib
import importlib.util
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, Protocol

_PATIENCE = 1.0
"""Seconds; work that ends sooner shows no bar."""
_TERMINAL, _FILE = 0.2, 10.0
"""Seconds between two updates of the bar, in a terminal and in a file."""

Listener = Callable[[int, int], None]
"""A user's function of the work done and the whole work."""


class Tell(Protocol):
    """The function that working code calls: the work done, the whole if known, and a note."""

    def __call__(self, done: int, total: int | None = None, note: str = "", /) -> None: ...


@contextlib.contextmanager
def progress_of(
    wanted: bool | Listener | None, unit: str, describe: str, ticks: bool = False
) -> Iterator[Tell]:
    """Yield the `Tell` to call while working.

    `wanted`: True shows a bar on stderr once the work has lasted a second. None does so if stderr
    is a terminal or this is a notebook. False shows nothing. A function is called with the work
    done and the whole (None if unknown). The bar begins with `describe`, counts in `unit`, shows
    the rate and, if the whole is known, the time left, and ends with the last note. If it `ticks`,
    it has the time so far and the last note only, also between two calls. Raises ValueError for
    other values.
    """
    require_progress(wanted)
    if callable(wanted):
        listener: Any = wanted
        yield lambda done, total=None, note="", /: listener(done, total)
        return
    if not _is_shown(wanted):
        yield lambda done, total=None, note="", /: None
        return
    bar = _bar_type()(
        desc=describe,
        unit=f" {unit}",
        unit_scale=True,
        file=sys.stderr,
        delay=_PATIENCE,
        mininterval=_TERMINAL if (watched := _is_shown(None)) else _FILE,
        # Without a minimum of steps, a note alone is shown too.
        miniters=0,
        dynamic_ncols=watched,
        bar_format="{desc}: {elapsed}{postfix}" if ticks else None,
    )

    def tell(done: int, total: int | None = None, note: str = "", /) -> None:
        bar.total = total
        bar.set_postfix_str(note, refresh=False)
        bar.update(done - bar.n)

    with contextlib.closing(bar), _ticking(bar) if ticks else contextlib.nullcontext():
        yield tell


@contextlib.contextmanager
def _ticking(bar: Any) -> Iterator[None]:
    """Show the bar by another thread too, as compilation blocks the caller."""
    over = threading.Event()

    def tick() -> None:
        while not over.wait(_TERMINAL):
            if bar.postfix:
                bar.update(0)

    # A file has the first note after a second, too.
    bar.last_print_t -= bar.mininterval
    (clock := threading.Thread(target=tick, daemon=True)).start()
    try:
        yield
    finally:
        over.set()
        clock.join()


class TellRun:
    """Functions that a simulation calls to show its work and its progress."""

    def __init__(self, tell: Tell, listens: bool):
        self._tell, self._listens = tell, listens
        self._since: tuple[float, float] | None = None

    def says(self, note: str) -> None:
        """Show a note until the next call. The time left counts no seconds of "compiling"."""
        self._since = None if note == "compiling" else (time.monotonic(), 0.0)
        if not self._listens:
            self._tell(0, None, note)

    def __call__(self, count: int, things: str, reached: float, end: float) -> None:
        """Show the number of things so far, the simulated time of the whole, and the time left."""
        now, note = time.monotonic(), f"t = {reached:.4g} of {end:.4g} s, {count} {things}"
        began, first = self._since = self._since or (now, reached)
        if reached > first:
            note += f", {(now - began) * (end - reached) / (reached - first):.0f} s left"
        self._tell(count if self._listens else 0, None, note)


@contextlib.contextmanager
def progress_of_run(wanted: bool | Listener | None) -> Iterator[TellRun]:
    """Yield the `TellRun` of a simulation. A user's function gets the number of impacts or contacts
    and None, as the total is unknown. Raises ValueError for values that `progress_of` refuses.
    """
    with progress_of(wanted, "", "simulate", ticks=True) as tell:
        yield TellRun(tell, callable(wanted))


def require_progress(wanted: Any, arguments: str = "two numbers") -> None:
    """Raise ValueError for values that `progress_of` or `stages_of` does not accept."""
    # Imported here, so that --help of the command line does not wait for JAX.
    from .._entry import as_flag, refusal

    if not callable(wanted) and wanted is not None and as_flag(wanted) is None:
        raise refusal("progress", f"be True, False, None or a function of {arguments}", wanted)


def _is_shown(wanted: Any) -> bool:
    """Return whether to write on stderr; for None, if that is a terminal or a notebook."""
    from .._entry import as_flag

    return sys.stderr.isatty() or in_notebook() if wanted is None else bool(as_flag(wanted))


def _bar_type() -> Any:
    """Return the notebook widget if it can be shown, otherwise the line of text."""
    if in_notebook() and importlib.util.find_spec("ipywidgets"):
        from tqdm.notebook import tqdm
    else:
        from tqdm import tqdm
    return tqdm


def in_notebook() -> bool:
    """Return whether this runs in a notebook cell, whose stderr is shown but is not a terminal."""
    shell = sys.modules.get("IPython")
    get = getattr(shell, "get_ipython", None)
    return get is not None and getattr(get(), "kernel", None) is not None


def stages_of(wanted: bool | Callable[[str], None] | None) -> Callable[[str], None]:
    """Return the function to call with each stage: the user's, or `Stages`.

    None writes as `progress_of` does: after a second, if stderr is a terminal or this is a
    notebook. Raises ValueError for other values.
    """
    require_progress(wanted, "a text")
    if callable(wanted):
        return wanted
    return Stages(quiet=not _is_shown(wanted), patience=_PATIENCE if wanted is None else 0.0)


class Stages:
    """Writes each stage of a command on stderr: "[  1.2 s] drawing ...", or nothing if `quiet`.

    Stages that begin before `patience` seconds are not written.
    """

    def __init__(self, *, quiet: bool = False, patience: float = 0.0):
        self._quiet, self._patience = quiet, patience
        self._start = time.monotonic()

    def __call__(self, stage: str) -> None:
        """Announce a stage that may take more than a second."""
        seconds = time.monotonic() - self._start
        if not self._quiet and seconds >= self._patience:
            print(f"[{seconds:5.1f} s] {stage} ...", file=sys.stderr, flush=True)

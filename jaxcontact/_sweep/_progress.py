"""Progress of a sweep on stderr: lanes done, rate and time left."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager

_PATIENCE = 1.0
"""Seconds: what is done sooner needs no progress."""
_TERMINAL, _FILE = 0.2, 10.0
"""Seconds between lines on a terminal, where they replace each other, and elsewhere."""

Listener = Callable[[int, int], None]


def progress_of(wanted: bool | Listener | None) -> AbstractContextManager[Listener]:
    """What to call with the lanes done and all lanes: silent, lines on stderr, or the user's own.

    Raises ValueError for what is none of these.
    """
    if callable(wanted):
        return contextlib.nullcontext(wanted)
    if wanted is not None and not isinstance(wanted, bool):
        raise ValueError(
            "Argument `progress` must be True, False, None or a function of two numbers, "
            f"but is {wanted!r}."
        )
    terminal = sys.stderr.isatty() or in_notebook()
    shown = terminal if wanted is None else wanted
    if not shown:
        return contextlib.nullcontext(lambda done, total: None)
    return Progress(replace=terminal)


def in_notebook() -> bool:
    """Whether this runs in a cell of a notebook, whose stderr is no terminal and is looked at."""
    shell = sys.modules.get("IPython")
    get = getattr(shell, "get_ipython", None)
    return get is not None and getattr(get(), "kernel", None) is not None


class Progress:
    """Writes a line now and then, once a sweep has lasted longer than a second."""

    def __init__(self, *, replace: bool, clock: Callable[[], float] = time.monotonic):
        self._replace = replace
        self._every = _TERMINAL if replace else _FILE
        self._clock = clock
        self._start = clock()
        self._next = self._start + _PATIENCE
        self._width = 0

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self._replace and self._width:
            print(file=sys.stderr, flush=True)

    def __call__(self, done: int, total: int) -> None:
        """Tell that `done` lanes of `total` are finished."""
        now = self._clock()
        last = done == total and self._width
        if now < self._next and not last:
            return
        self._next = now + self._every
        line = self.line(done, total, now - self._start)
        if self._replace:
            # A shorter line must cover what is left of a longer one.
            print(f"\r{line:<{self._width}}", end="", file=sys.stderr, flush=True)
        else:
            print(line, file=sys.stderr, flush=True)
        self._width = len(line)

    @staticmethod
    def line(done: int, total: int, seconds: float) -> str:
        """The line itself."""
        rate = done / seconds if seconds > 0 else 0.0
        text = f"sweep: {done:,} of {total:,} lanes"
        if rate > 0:
            text += f", {rate:,.3g} lanes/s" if rate < 1000 else f", {rate:,.0f} lanes/s"
        if done == total:
            return f"{text}, {_time(seconds)}"
        return f"{text}, {_time((total - done) / rate)} left" if rate > 0 else text


def _time(seconds: float) -> str:
    if seconds < 60:
        return f"{seconds:.0f} s"
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {seconds:02d} s"

"""Progress on stderr: what is being done, and how long since the start."""

from __future__ import annotations

import sys
import time


class Progress:
    """Prints each stage as a line on stderr, at once and with the seconds since the start."""

    def __init__(self, *, quiet: bool = False):
        self._quiet = quiet
        self._start = time.monotonic()

    def __call__(self, stage: str) -> None:
        """Announce a stage that may take more than a second."""
        if not self._quiet:
            seconds = time.monotonic() - self._start
            print(f"[{seconds:5.1f} s] {stage} ...", file=sys.stderr, flush=True)

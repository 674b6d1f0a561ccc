"""Numbers and ranges of numbers on the command line, checked on entry."""

from __future__ import annotations

import argparse
import contextlib
import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any


class InputError(ValueError):
    """Invalid input of the user; the message is shown to the user."""


@contextlib.contextmanager
def input_errors(said: Callable[[str], str] = str) -> Iterator[None]:
    """Make each ValueError of a block one of the input, with its text as `said` here."""
    try:
        yield
    except InputError:
        raise
    except ValueError as error:
        raise InputError(said(str(error))) from error


def positive(text: str) -> float:
    """Return a positive, finite number; for argparse, whose message then names the option."""
    value = number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"must be positive, but is {text}")
    return value


def number(text: str) -> float:
    """Return a finite number; for argparse."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a finite number")
    return value


def assignment(text: str, read: Callable[[str], Any], form: str) -> tuple[str, Any]:
    """Parse `NAME=VALUE`, with the value by `read`; for argparse. `form` is VALUE in the help."""
    name, equals, value = text.partition("=")
    if not equals or not name.isidentifier():
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form NAME={form}")
    return name, read(value)


if TYPE_CHECKING:
    import numpy as np


def span(text: str) -> float | np.ndarray:
    """Return a number, or the numbers of FROM:TO:COUNT or FROM:TO:COUNT:log; for argparse."""
    import numpy as np

    parts = text.split(":")
    if len(parts) == 1:
        return number(text)
    if len(parts) not in (3, 4) or (len(parts) == 4 and parts[3] != "log"):
        raise argparse.ArgumentTypeError(
            f"{text!r} is neither a number nor of the form FROM:TO:COUNT or FROM:TO:COUNT:log"
        )
    low, high = number(parts[0]), number(parts[1])
    if not parts[2].isdecimal() or int(parts[2]) < 1:
        raise argparse.ArgumentTypeError(f"{parts[2]!r} in {text!r} is not a count")
    if len(parts) == 3:
        return np.linspace(low, high, int(parts[2]))
    if low <= 0 or high <= 0:
        raise argparse.ArgumentTypeError(f"{text!r} must be positive to be spaced by a factor")
    return np.geomspace(low, high, int(parts[2]))

"""Numbers on the command line, checked where they come in."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Any


class InputError(ValueError):
    """Something the user gave cannot be used; the message is for the user."""


def positive(text: str) -> float:
    """A positive, finite number; for argparse, whose message then names the option."""
    value = number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"must be positive, but is {text}")
    return value


def number(text: str) -> float:
    """A finite number; for argparse."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a finite number")
    return value


def assignment(text: str, read: Callable[[str], Any], form: str) -> tuple[str, Any]:
    """`NAME=VALUE`, the value by `read`; for argparse, with what help shows as VALUE in `form`."""
    name, equals, value = text.partition("=")
    if not equals or not name.isidentifier():
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form NAME={form}")
    return name, read(value)

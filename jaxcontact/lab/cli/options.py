"""Options as tables, the values they read, errors in words of options, and output."""

from __future__ import annotations

import argparse
import contextlib
import functools
import json
import math
import pathlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

from ...extend import wrapped

if TYPE_CHECKING:
    import numpy as np


class InputError(ValueError):
    """Invalid input of the user; the message is shown to the user."""


class Output(NamedTuple):
    """What a command prints, line by line or as JSON, what it writes, and its exit code."""

    shown: Sequence[object]
    data: Any
    files: Mapping[pathlib.Path, bytes | Callable[[BinaryIO], object]] = {}
    code: int = 0


def written(files: Mapping[pathlib.Path, object]) -> str:
    """Return the line that names the written files."""
    return "\n".join(wrapped("Written", ", ".join(map(str, files))))


def add_options(parser: argparse.ArgumentParser, table: str) -> None:
    """Add the options of a table with lines `--name VALUE | kind, how | help`.

    The kind reads the VALUE, or that of NAME=VALUE: one of `KINDS`, `choice` with its words, or
    nothing for a text; `flag` has none. `how` is `required` or `= default`. A [VALUE] is optional,
    and `VALUE ...` may be repeated. An indented line continues the help; `# title: words` begins a
    group.
    """
    place: Any = parser
    for line in filter(None, re.sub(r"\n +", " ", table).splitlines()):
        if line.startswith("#"):
            place = parser.add_argument_group(*line.strip("# ").split(": "))
            continue
        left, kinds, words = (part.strip() for part in line.split("|", 2))
        how = kinds.split(", ")
        kind, *choices = how[0].split() or [""]
        name, *value = left.strip("[]").split()
        settings: dict[str, Any] = {"help": words, "required": "required" in how}
        if not name.startswith("-"):
            settings = {"help": words, "metavar": name}
            if left.startswith("["):
                settings["nargs"] = "*" if value else "?"
            name = name.lower()
        elif value:
            settings["metavar"] = value[0].strip("[]")
        form = settings.get("metavar", "").partition("=")[2]
        if read := KINDS.get(kind):
            settings["type"] = functools.partial(assignment, read=read, form=form) if form else read
        if kind == "choice":
            settings["choices"] = tuple(choices)
        elif kind == "flag":
            settings["action"] = "store_true"
        elif value[1:]:
            settings |= {"action": "append", "default": []}
        elif value and left.startswith("-") and left.endswith("]"):
            settings |= {"nargs": "?", "const": math.inf if read else ""}
        default = next((one[1:].strip() for one in how if one.startswith("=")), None)
        place.add_argument(name, **settings | ({"default": default} if default else {}))


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


def plain_value(text: str) -> int | float | str:
    """Return a whole number, a number, or the text itself."""
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(text)
    return text


KINDS: dict[str, Callable[[str], Any]] = {
    "positive": positive,
    "number": number,
    "count": int,
    "range": span,
    "value": plain_value,
}


@contextlib.contextmanager
def input_errors(said: Callable[[str], str] = str) -> Iterator[None]:
    """Make each ValueError of a block one of the input, with its text as `said` here."""
    try:
        yield
    except InputError:
        raise
    except ValueError as error:
        raise InputError(said(str(error))) from error


def naming(options: str, **others: str) -> Callable[[str], str]:
    """Return a function that puts options in place of the arguments that an error names.

    `others` are the options for arguments of another name.
    """
    names = {name: name for name in options.split()} | others

    def option(found: re.Match[str]) -> str:
        if found[1] not in names:
            return found[0]
        return f"--{names[found[1]].replace('_', '-')}{found[2] and ' ' + found[2]}"

    return lambda text: re.sub(r'(?:Argument )?`(\w+)=?((?:"[^"]*")?)`', option, text)


READ = "columns decimal ball rate sheet"
"""Options of a reader."""


def table_asked(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the arguments of a reader for the options of a table."""
    return {name: getattr(arguments, name) for name in ("columns", "decimal", "sheet")}


def refuse(arguments: argparse.Namespace, names: Sequence[str], why: str) -> None:
    """Raise InputError if one of the options is given."""
    for name in names:
        if getattr(arguments, name) not in (None, "all", []):
            raise InputError(f"--{name.replace('_', '-')} {why}")


def print_json(result: Any) -> None:
    """Print a result of dicts, lists, texts, numbers and arrays; a text as it is."""
    if isinstance(result, str):
        print(result, end="")
    else:
        print(json.dumps(plain(result), indent=1, ensure_ascii=False, allow_nan=False))


def plain(value: Any) -> Any:
    """Convert arrays to lists, numbers to Python's, and non-finite ones to None."""
    if isinstance(value, Mapping):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    import numpy as np

    # The remaining values are arrays and numbers of NumPy and JAX.
    return plain(np.asarray(value).tolist())


def fields(result: object, names: str) -> dict[str, Any]:
    """Return some attributes of a result, for JSON."""
    return {name: getattr(result, name) for name in names.split()}


def output_folder(name: str) -> pathlib.Path:
    """Return the folder of `--out`, which may be missing; raise InputError for a file."""
    path = pathlib.Path(name)
    if path.exists() and not path.is_dir():
        raise InputError(f"--out {path} is not a folder")
    return path


def output_path(option: str, name: str, suffixes: Sequence[str]) -> pathlib.Path:
    """Return the file to write; raise InputError unless its name ends in one of `suffixes`."""
    path = pathlib.Path(name)
    if path.suffix.lower() not in suffixes:
        allowed = " or ".join([*filter(None, [", ".join(suffixes[:-1])]), suffixes[-1]])
        raise InputError(f"{option} {name}: the name must end in {allowed}")
    if path.exists() and not path.is_file():
        kind = "folder" if path.is_dir() else "pipe or a device"
        raise InputError(f"{option} {name}: is a {kind}")
    return path

"""References that take seconds, as data: a `stored` function is read for arguments it has had.

    JAXCONTACT_STORE=1 pytest FILES     computes what is missing, and writes it to stored.json

The key holds the arguments to twelve digits, functions among them by their values at some points,
and the text of the function, or of its module in this folder: what has changed is computed. So is
the first call of each function in a process, which has to give what is stored.
"""

import atexit
import dataclasses
import functools
import hashlib
import inspect
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

FILE = Path(__file__).with_name("stored.json")

SAME = 1e-9
"""Of a value that is computed again, relative to the largest in its array: other versions of SciPy
and other processors round otherwise.
"""

DIGITS = 12


@functools.cache
def _known() -> dict[str, Any]:
    return json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}


def _plain(value: Any, points: dict[int, list]) -> Any:
    """An argument as JSON: a function by its values at the points for its number of arguments."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if dataclasses.is_dataclass(value):
        fields = [getattr(value, one.name) for one in dataclasses.fields(value)]
        return [type(value).__name__, _plain(fields, points)]
    if callable(value):
        count = sum(
            one.default is one.empty and one.kind is one.POSITIONAL_OR_KEYWORD
            for one in inspect.signature(value).parameters.values()
        )
        return [_plain(value(*point), points) for point in points[count]]
    if isinstance(value, dict):
        return {str(name): _plain(one, points) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one, points) for one in value]
    array = np.asarray(value)
    return f"{array:.{DIGITS}g}" if array.ndim == 0 else [_plain(x, points) for x in array]


def _packed(value: Any) -> Any:
    """A value as JSON that `_unpacked` reads: arrays, and classes of numbers, by name."""
    if isinstance(value, np.ndarray | np.floating):
        return {"array": value.tolist()}
    if isinstance(value, dict):
        return {"dict": {name: _packed(one) for name, one in value.items()}}
    if dataclasses.is_dataclass(value):
        parts = {one.name: getattr(value, one.name) for one in dataclasses.fields(value)}
    elif hasattr(value, "_asdict"):
        parts = value._asdict()
    elif isinstance(value, list | tuple):
        kind = "list" if isinstance(value, list) else "tuple"
        return {kind: [_packed(one) for one in value]}
    else:
        return value
    return {"class": type(value).__name__, "with": {k: _packed(v) for k, v in parts.items()}}


def _unpacked(value: Any, names: dict[str, Any]) -> Any:
    if not isinstance(value, dict):
        return value
    if "array" in value:
        array = np.array(value["array"])
        return array if array.ndim else array[()]
    if "class" in value:
        parts = {k: _unpacked(v, names) for k, v in value["with"].items()}
        return names[value["class"]](**parts)
    if "dict" in value:
        return {name: _unpacked(one, names) for name, one in value["dict"].items()}
    ((kind, some),) = value.items()
    return {"list": list, "tuple": tuple}[kind](_unpacked(one, names) for one in some)


def _leaves(value: Any) -> list[np.ndarray]:
    """All that is in a packed value; None is NaN."""
    if isinstance(value, dict):
        return [leaf for one in value.values() for leaf in _leaves(one)]
    if isinstance(value, list) and any(isinstance(one, dict | str) for one in value):
        return [leaf for one in value for leaf in _leaves(one)]
    return [] if isinstance(value, str) else [np.array(value, float)]


def _assert_same(found: Any, expected: Any) -> None:
    pairs = zip(_leaves(found), _leaves(expected), strict=True)
    for one, other in pairs:
        size = np.max(np.abs(other[np.isfinite(other)]), initial=1e-300)
        np.testing.assert_allclose(one, other, rtol=SAME, atol=SAME * size)


def stored(points: dict[int, list] | None = None):
    """Store what a function returns; `points` are arguments of functions, by their number."""

    def of(function):
        module = sys.modules[function.__module__]
        whole = module.__name__.startswith("tests.oracle.")
        text = inspect.getsource(module if whole else function)
        compared = []

        @functools.wraps(function)
        def read(*given, **words):
            bound = inspect.signature(function).bind(*given, **words)
            bound.apply_defaults()
            plain = _plain(dict(bound.arguments), points or {})
            asked = json.dumps([text, plain]).encode()
            key = f"{module.__name__}.{function.__name__} {hashlib.sha256(asked).hexdigest()[:16]}"
            known = _known()
            if key in known and compared:
                return _unpacked(known[key], vars(module))
            value = function(*given, **words)
            packed = json.loads(json.dumps(_packed(value)))
            if key in known:
                compared.append(key)
                _assert_same(packed, known[key])
            elif os.environ.get("JAXCONTACT_STORE"):
                known[key] = packed
            return value

        return read

    return of


@atexit.register
def _write() -> None:
    if os.environ.get("JAXCONTACT_STORE"):
        # Another process may have written meanwhile.
        all_ = _known() | (json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {})
        lines = [f"{json.dumps(key)}: {json.dumps(all_[key])}" for key in sorted(all_)]
        FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")

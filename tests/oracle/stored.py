"""References that take seconds, as data: a `stored` function is read for arguments it has had.

    JAXCONTACT_STORE=1 pytest FILES     computes what is missing, and writes it to stored.json

The key holds the arguments to twelve digits, and the text of the function, or of its module in this
folder: what has changed is computed. So is the first call of each function in a process, which has
to give what is stored.
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
"""Of what is computed again, relative to the largest in its array: processors round otherwise."""


def _read() -> dict[str, Any]:
    return json.loads(FILE.read_text(encoding="utf-8"))


_known = functools.cache(_read)


def _plain(value: Any) -> Any:
    if value is None or isinstance(value, bool | int | str):
        return value
    if dataclasses.is_dataclass(value):
        return [type(value).__name__, _plain(list(vars(value).values()))]
    if isinstance(value, dict):
        return {str(name): _plain(one) for name, one in value.items()}
    if isinstance(value, list | tuple) or np.ndim(value):
        return [_plain(one) for one in value]
    return f"{np.asarray(value):.12g}"


def _packed(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return {"array": value.tolist()}
    if dataclasses.is_dataclass(value):
        return {"class": type(value).__name__, "with": _packed(vars(value))["dict"]}
    if isinstance(value, dict):
        return {"dict": {name: _packed(one) for name, one in value.items()}}
    if isinstance(value, list | tuple):
        return {type(value).__name__: [_packed(one) for one in value]}
    return value


def _made(names: dict[str, Any], found: dict[str, Any]) -> Any:
    if "class" in found:
        return names[found["class"]](**found["with"])
    for kind, make in (("array", np.array), ("tuple", tuple), ("list", list), ("dict", dict)):
        if kind in found:
            return make(found[kind])
    return found


def _arrays(value: Any) -> list[np.ndarray]:
    """All that is in a packed value; None is NaN."""
    if isinstance(value, dict):
        return [array for one in value.values() for array in _arrays(one)]
    if isinstance(value, list) and any(isinstance(one, dict) for one in value):
        return [array for one in value for array in _arrays(one)]
    return [] if isinstance(value, str) else [np.array(value, float)]


def stored():
    """Store what a function returns."""

    def of(function):
        module, compared = sys.modules[function.__module__], []
        whole = module.__name__.startswith("tests.oracle.")
        text = inspect.getsource(module if whole else function)

        @functools.wraps(function)
        def read(*given):
            names = inspect.signature(function).parameters
            asked = json.dumps([text, _plain(dict(zip(names, given, strict=True)))]).encode()
            key = f"{module.__name__}.{function.__name__} {hashlib.sha256(asked).hexdigest()[:16]}"
            known = _known().get(key)
            if known is not None and compared:
                made = functools.partial(_made, vars(module))
                return json.loads(json.dumps(known), object_hook=made)
            value = function(*given)
            packed = json.loads(json.dumps(_packed(value)))
            if known is None:
                _known()[key] = packed
                return value
            compared.append(key)
            for one, other in zip(_arrays(packed), _arrays(known), strict=True):
                size = np.max(np.abs(other[np.isfinite(other)]), initial=1e-300)
                np.testing.assert_allclose(one, other, rtol=SAME, atol=SAME * size)
            return value

        return read

    return of


@atexit.register
def _write() -> None:
    """Beside what another process has written meanwhile."""
    if os.environ.get("JAXCONTACT_STORE"):
        found = _known() | _read()
        lines = [f"{json.dumps(key)}: {json.dumps(found[key])}" for key in sorted(found)]
        FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")

"""The summary of a calibration: plain data with report, export and file."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import types
import typing
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from ... import AbstractLaw, Contact, get_law, list_laws
from ...extend import describe, read_whole, require_path, write_all
from ..choice.kinds import kind_of_law, law_in
from .report import report, short
from .summary_data import SummaryData

VERSION = 7
"""Version of the file format; raised when a field is added, removed or changes its meaning."""

_SPEEDS = 17
"""Number of closing speeds of an export, over the measured range."""


@dataclasses.dataclass(frozen=True, repr=False)
class CalibrationSummary(SummaryData):  # noqa: D101 (that of its data)
    __doc__ = SummaryData.__doc__

    def table(self) -> str:
        """Return the kinds of laws with their parameters and criteria as text; lower is better."""
        return self.choice.table()

    def report(self) -> str:
        """Return the full report, verdict first.

        It has what `print` shows, then data, marked pairs, fits, their comparison, and open
        questions.
        """
        return report(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the plain data as JSON, completely or not at all; `load_calibration` reads it.

        Raises OSError if writing fails, and ValueError for a number that is not finite.
        """
        write_all({require_path("path", path): self.to_json().encode()})

    def to_json(self) -> str:
        """Return the text that `save` writes."""
        whole = {"format_version": VERSION, **_encode(self, CalibrationSummary, "")}
        return json.dumps(whole, indent=1, ensure_ascii=False, allow_nan=False) + "\n"

    def __export__(
        self, contact: Contact | None
    ) -> tuple[AbstractLaw, Contact, Float[np.ndarray, " n"]]:
        """Return law, contact and closing speeds in m/s over the measured range, for `export`.

        With another `contact`, the law is converted to keep e(v). Raises ValueError if no fit
        converged, or if mass or stiffness is unknown.
        """
        if self.law is None:
            raise ValueError("Argument `law` must have a converged fit, but no fit converged.")
        kind = kind_of_law(self.law)
        missing = [name for name in ("mass", "stiffness") if name not in self.given]
        if contact is None and missing:
            words = " and ".join(f"`{name}`" for name in missing)
            raise ValueError(
                f"Argument `contact` is needed: this calibration was made without {words} and "
                f"does not determine {kind.unidentified}. Give `contact=Contact(mass, "
                f"stiffness)`, or calibrate with {words}."
            )
        kept = [pair.velocity for pair in self.pairs if not pair.marked]
        speeds = np.geomspace(min(kept), max(kept), _SPEEDS)
        if contact is None:
            return self.law, self.contact, speeds
        return law_in(self.law, self.contact, contact), contact, speeds

    def __repr__(self) -> str:
        return short(self)


def load_calibration(path: str | os.PathLike[str]) -> CalibrationSummary:
    """Load the calibration that `Calibration.save` wrote, every number to its last bit.

    Returns a `CalibrationSummary` as plain data: `.law`, `.contact`, `.standard_errors`, `.choice`
    and all other results. Raises ValueError, which names file and field, for an unknown format
    version, an unknown or missing field, an unknown law, and a number that is missing or not
    finite. Raises ValueError for an invalid path, and OSError for a file that cannot be read.
    """
    file = require_path("path", path)
    try:
        text = read_whole(file).decode("utf-8")
        data = json.loads(text, parse_constant=lambda name: _refuse("", f"holds {name}"))
        if not isinstance(data, dict) or "format_version" not in data:
            raise FormatError("format_version is missing")
        version = data.pop("format_version")
        if version == VERSION - 1:
            data |= {"check": None, "stiffness_error": None}
        elif version != VERSION:
            raise FormatError(f"format_version must be {VERSION - 1} or {VERSION}")
        with jax.enable_x64(True):
            return _decode(data, CalibrationSummary, "")
    except json.JSONDecodeError as error:
        raise ValueError(f"{file}: is not JSON: {error}") from error
    except (FormatError, UnicodeDecodeError) as error:
        raise ValueError(f"{file}: {error}") from error


class FormatError(ValueError):
    """A file whose content does not match the format; the message names the field."""


def _refuse(where: str, what: str) -> typing.NoReturn:
    raise FormatError(f"{where.lstrip('.') or 'the file'} {what}")


def _required_type(hint: Any, value: Any) -> Any:
    """Return the required type of a value; for `X | None` and the value None, NoneType."""
    choices = typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)
    if value is None and types.NoneType in choices:
        return types.NoneType
    return next(choice for choice in choices if choice is not types.NoneType)


def _hints(cls: Any) -> dict[str, Any]:
    if cls is Contact:
        return dict.fromkeys(("mass", "stiffness", "exponent"), float)
    hints = typing.get_type_hints(cls)
    return {field.name: hints[field.name] for field in dataclasses.fields(cls)}


def _encode(value: Any, hint: Any, where: str) -> Any:
    hint = _required_type(hint, value)
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin is tuple:
        return [_encode(v, inner[0], f"{where}[{i}]") for i, v in enumerate(value)]
    if origin is dict:
        return {name: _encode(v, inner[1], f"{where}.{name}") for name, v in value.items()}
    if hint is AbstractLaw:
        law = next(n for n in list_laws() if describe(n).cls is type(value))
        parameters = {p: float(getattr(value, p)) for p in describe(law).parameters}
        return {"name": law, "parameters": parameters, "tension": value.tension}
    if dataclasses.is_dataclass(hint):
        return {
            name: _encode(getattr(value, name), own, f"{where}.{name}")
            for name, own in _hints(hint).items()
        }
    if hint is types.NoneType:
        return None
    if hint is float and not math.isfinite(value):
        raise ValueError(f"Cannot be saved: {where.lstrip('.')} is {value!r}.")
    return hint(value)


def _decode(value: Any, hint: Any, where: str) -> Any:
    hint = _required_type(hint, value)
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin is tuple:
        _expect(value, list, "a list", where)
        return tuple(_decode(v, inner[0], f"{where}[{i}]") for i, v in enumerate(value))
    if origin is dict:
        _expect(value, dict, "an object", where)
        return {name: _decode(v, inner[1], f"{where}.{name}") for name, v in value.items()}
    if hint is AbstractLaw:
        return _law_of(value, where)
    if dataclasses.is_dataclass(hint):
        hints = _hints(hint)
        _check_fields(value, hints, where)
        numbers = {n: _decode(value[n], own, f"{where}.{n}") for n, own in hints.items()}
        return _construct(lambda: hint(**numbers), where)  # pyright: ignore[reportCallIssue]
    if hint is float:
        return _number(value, where)
    if type(value) is not hint:
        _refuse(where, f"must be of type {hint.__name__}, but is {value!r}")
    return value


def _number(value: Any, where: str) -> float:
    if type(value) not in (int, float):
        _refuse(where, f"must be a number, but is {value!r}")
    try:
        return float(value)
    except OverflowError:
        _refuse(where, "must be finite, but is too large")


def _expect(value: Any, kind: type, name: str, where: str) -> None:
    if not isinstance(value, kind):
        _refuse(where, f"must be {name}, but is {value!r}")


def _check_fields(value: Any, wanted: Any, where: str) -> None:
    _expect(value, dict, "an object", where)
    for name in value:
        if name not in wanted:
            _refuse(f"{where}.{name}", f"is unknown; known are {', '.join(wanted)}")
    for name in wanted:
        if name not in value:
            _refuse(f"{where}.{name}", "is missing")


def _law_of(value: Any, where: str) -> AbstractLaw:
    _check_fields(value, ("name", "parameters", "tension"), where)
    name, tension = value["name"], value["tension"]
    if name not in list_laws():
        _refuse(f"{where}.name", f"must be one of {', '.join(list_laws())}, but is {name!r}")
    _expect(tension, bool, "true or false", f"{where}.tension")
    given, wanted = value["parameters"], describe(name).parameters
    _check_fields(given, wanted, f"{where}.parameters")
    numbers = {p: _decode(given[p], float, f"{where}.parameters.{p}") for p in wanted}
    return _construct(lambda: get_law(name, **numbers, tension=tension), where)


def _construct(make: typing.Callable[[], Any], where: str) -> Any:
    try:
        return make()
    except ValueError as error:
        _refuse(where, f"is out of range: {error}")

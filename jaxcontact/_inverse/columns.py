"""Checks of measured columns: ranges of plausible readings, and guesses of a wrong unit."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from jaxtyping import ArrayLike, Float

from .._entry import RESTITUTION, Range, as_numbers, refusal, rendered
from .._flight import STANDARD_GRAVITY, Floats
from .._text.units import Shown

MEASURED_RESTITUTION = Range(low=0.0, high=1.2, low_open=True, inside=0.5)
"""Range of a measured e, which noise may raise above 1."""
MEASURED_RESTITUTION_FROM_ZERO = Range(low=0.0, high=1.2, inside=0.5)

_AROUND = math.sqrt(10)
"""Half of a factor of ten, on a logarithmic scale: the limit between two units."""

_LONG = 20.0
"""Longest plausible interval in s; such a flight rises half a kilometre."""

EVEN = 0.985
"""Ratio of successive intervals above which they are those of a clock, not of a ball."""

_MOST_COMPARED = 200


def length_guess(times: float) -> str:
    """Return the unit of a length that is `times` too large; "" if unclear."""
    for unit, size in (("cm", 100), ("mm", 1000)):
        if size / _AROUND < times < size * _AROUND:
            return f"; is it in {unit}? then divide by {size}"
    return ""


def too_long(seconds: ArrayLike | list[float], gravity: float = STANDARD_GRAVITY) -> str:
    """Return why these are not intervals in s, with a guess of their unit; "" if plausible."""
    typical = float(np.median(np.asarray(seconds)))
    rise = gravity * typical**2 / 8
    if rise <= STANDARD_GRAVITY * _LONG**2 / 8:
        return ""
    return (
        f"half of the intervals are longer than {typical:g} s, in which a ball rises {rise:.0f} m; "
        "are they in ms? then divide by 1000"
    )


def not_shrinking(chains: Iterable[Floats], power: float = 1.0) -> float | None:
    """Return the median factor between successive intervals if no ball can have it, or None.

    `chains` are successive intervals (n,) of one trial each, or heights with `power` 2. The result
    is not None if two conditions hold. The factor is above `EVEN` to this power. And shorter
    intervals than before do not clearly outnumber longer ones: by less than two standard deviations
    of Kendall's (1938) count, doi 10.1093/biomet/30.1-2.81.
    """
    steps, score, variance = [], 0.0, 0.0
    for chain in chains:
        one = chain[:_MOST_COMPARED]
        n = one.size
        steps.append(one[1:] / one[:-1])
        score += float(np.sum(np.tril(np.sign(one[:, None] - one), -1)))
        variance += n * (n - 1) * (2 * n + 5) / 18
    ratios = np.concatenate(steps or [np.zeros(0)])
    if not ratios.size or score <= -2 * math.sqrt(variance):
        return None
    middle = float(np.median(ratios))
    return middle if middle > EVEN**power else None


Column = Float[np.ndarray, " n"]


def column(
    value: ArrayLike,
    name: str,
    allowed: Range,
    beside: tuple[str, Column] | None = None,
    *,
    least: int = 1,
    gaps: bool = False,
) -> Column:
    """Return a measured column (n,) with every number in range; with `gaps`, NaN marks a gap."""
    array = as_numbers(value, name)
    if array.ndim != 1 or array.size < least:
        enough = f" with at least {least} points" if least > 1 else ""
        raise ValueError(
            f"Argument `{name}` must have the shape (points,){enough}, but is of shape "
            f"{array.shape}: it is {rendered(value)}."
        )
    if beside is not None and array.size != len(beside[1]):
        raise ValueError(
            f"Argument `{name}` must have one number for each of the {len(beside[1])} points of "
            f"`{beside[0]}`, but has {array.size}: it is {rendered(value)}."
        )
    bad = ~(allowed.holds(array) | (gaps & np.isnan(array)))
    if bad.any():
        i = int(np.argmax(bad))
        raise ValueError(
            f"Argument `{name}` must be in {allowed}, but is {array[i]:g} at point {i}."
            f"{_guess(array, allowed)}"
        )
    return array


def _guess(array: Column, allowed: Range) -> str:
    """Return a guess of the unit of restitutions; "" if unclear."""
    there = array[array == array]
    if not there.size or allowed.high not in (RESTITUTION.high, MEASURED_RESTITUTION.high):
        return ""
    percent = np.median(there) > 2 and there.max() <= 120
    return " Is it in percent? Then divide by 100." if percent else ""


ASKED_AND_DELIVERED = {
    "x": Shown("e"),
    "": Shown("restitution", "restitution delivered"),
}
"""Presentation of the columns of `asked_and_delivered`."""


def asked_and_delivered(e_in: ArrayLike, e_out: ArrayLike | None) -> tuple[Column, Column]:
    """Return the columns `e_in` in (0, 1] and `e_out`, measured; without `e_out`, `e_in` twice."""
    asked = column(e_in, "e_in", RESTITUTION)
    if e_out is None:
        return asked, asked
    return asked, column(e_out, "e_out", MEASURED_RESTITUTION, ("e_in", asked))


def measured(
    given: Mapping[str, tuple[Any, Any, Range]],
    beside: tuple[str, Column],
    *,
    gaps: bool = False,
    weight: Callable[[Column], float] = lambda values: 1.0,
) -> dict[str, Any]:
    """Return the arguments `data` and `sigma` or `weights` of `fit`, from named columns.

    `given` holds values, standard deviations and range of each; missing values are None. Without
    standard deviations a column counts with its `weight`. Raises ValueError without a column, for
    invalid ones, and for standard deviations of only some of them.
    """
    there = {name: one for name, one in given.items() if one[0] is not None}
    if not there:
        either = " or ".join(f"`{name}`" for name in given)
        none = "both" if len(given) == 2 else "all"
        raise ValueError(f"Argument {either} must be given, but {none} are None.")
    data = {
        name: column(values, name, allowed, beside, gaps=gaps)
        for name, (values, _, allowed) in there.items()
    }
    sigmas = {name: sigma for name, (_, sigma, _) in given.items() if sigma is not None}
    for name in sigmas.keys() - data.keys():
        raise refusal(f"sigma_{name}", f"be None without `{name}`", sigmas[name])
    if sigmas and len(sigmas) < len(data):
        both = " and ".join(f"`sigma_{name}`" for name in data)
        every = "both columns" if len(data) == 2 else "all columns"
        missing = next(name for name in data if name not in sigmas)
        raise ValueError(
            f"Arguments {both} must be given for {every} or for none, but `sigma_{missing}` "
            "is None."
        )
    numbers: dict[str, Any] = {name: weight(values) for name, values in data.items()}
    if sigmas:
        numbers = {n: for_each(sigmas[n], f"sigma_{n}", data[n].size) for n in data}
    gap = np.inf if sigmas else 0.0
    filled = {name: np.where(np.isnan(data[name]), gap, numbers[name]) for name in data}
    return {"data": data, "sigma" if sigmas else "weights": filled}


def with_transforms(own: Mapping[str, Any], how: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of `fit` with the transforms of a ready-made problem.

    Raises ValueError unless the user's `transforms` are a dict by name, or if they name one of the
    problem's own.
    """
    given = how.get("transforms")
    if given is not None and not isinstance(given, dict):
        raise refusal(
            "transforms", "be a dict of transforms by name beside those of this problem", given
        )
    twice = [name for name in given or {} if name in own]
    if twice:
        raise ValueError(
            "Argument `transforms` must not name what this problem transforms or fixes itself, "
            f"{', '.join(own)}, but names {', '.join(twice)}."
        )
    return {**how, "transforms": {**own, **(given or {})}}


def for_each(value: Any, name: str, length: int, *, zero: bool = False) -> Column:
    """Return a standard deviation or a weight for each point (n,), from one for all or one each.

    Raises ValueError unless numbers are above 0 (or not negative, with `zero`). An infinite
    standard deviation leaves a point out.
    """
    array = as_numbers(value, name)
    if array.shape not in ((), (length,)):
        raise ValueError(
            f"Argument `{name}` must have one number, or one for each of the {length} points, but "
            f"has the shape {array.shape}: it is {rendered(value)}."
        )
    good = (array >= 0) & np.isfinite(array) if zero else array > 0
    counts = array > 0 if zero else np.isfinite(array)
    if not good.all() or not counts.any():
        allowed = "finite and not negative" if zero else "positive (inf leaves a point out)"
        allowed += ", and leave some point in"
        raise refusal(name, f"be {allowed}", value)
    return np.broadcast_to(array, (length,))

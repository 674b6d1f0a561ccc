"""Axis labels: words, and a unit in which the numbers are short."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._text import units as units

if TYPE_CHECKING:
    from matplotlib.axis import Axis
    from matplotlib.ticker import Formatter

_PREFIXES = {-9: "n", -6: "µ", -3: "m", 3: "k", 6: "M", 9: "G"}

_MOST_PLACES = 6

_CLOSE = 1e-3
"""Ticks that span less than this fraction of their numbers are counted from the middle one."""

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

_BOTH = "N", "J", "Pa"
_DOWNWARDS = "s", "m", "m/s"
"""Units that take any prefix, and those that take small prefixes only."""


def put_label(
    axis: Axis, name: str, words: str | None = None, unit: Any = None, beside: Any = None
) -> None:
    """Label an axis by the name of its quantity, as in "time / ms", in its `unit` or another one.

    A linear axis gets the prefix that suits its largest number, or that of the axis `beside` it.
    The data and the limits stay in SI units; only the tick labels are divided.
    """
    unit = units.meaning(name)[1] if unit is None else unit
    power = _power((axis, axis if beside is None else beside), unit)
    if power:
        axis.set_major_formatter(_divide_by(power))
    axis.set_label_text(units.label(name, words, prefix=_PREFIXES.get(power, ""), unit=unit))


def _divide_by(power: int) -> Formatter:
    """Return a formatter of numbers divided by 10^power, all with the same decimal places."""
    from matplotlib.ticker import Formatter

    class Divided(Formatter):
        def __call__(self, x: float, pos: int | None = None) -> str:
            return self.format_ticks([x])[0]

        def format_ticks(self, values: Any) -> list[str]:
            numbers = np.asarray(values) / 10.0**power
            close = 1e-9 * np.abs(numbers).max(initial=1e-30)
            places = range(_MOST_PLACES)
            fitting = (d for d in places if np.all(np.abs(numbers.round(d) - numbers) <= close))
            digits = next(fitting, _MOST_PLACES)
            return [self.fix_minus(f"{x + 0.0:.{digits}f}") for x in numbers]

    return Divided()


def _power(axes: tuple[Axis, ...], unit: str) -> int:
    if unit not in (*_BOTH, *_DOWNWARDS) or axes[0].get_scale() != "linear":
        return 0
    # The limits of the axes include everything drawn before.
    ends = np.abs([axis.get_view_interval() for axis in axes])
    largest = float(ends.max()) if np.isfinite(ends).all() else 0.0
    if not largest > 0:
        return 0
    # Numbers of 0.1 and more are short without a prefix.
    power = 3 * math.floor(math.log10(largest * 10) / 3) if largest < 0.1 else 0
    if unit in _BOTH and largest >= 1e4:
        power = 3 * math.floor(math.log10(largest) / 3)
    return int(np.clip(power, -9, 9))


def put_few_ticks(axis: Axis, name: str, *, words: bool = True) -> None:
    """Set at most four ticks, in a unit and from an origin that make them short.

    With `words` the label states both: "contact.stiffness / (10⁸ N/m^n)".
    """
    from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator

    low, high = sorted(axis.get_view_interval())
    ticks = np.asarray(MaxNLocator(3, steps=[1, 2, 5, 10]).tick_values(low, high))
    ticks = ticks[(ticks >= low) & (ticks <= high)]
    largest = max(abs(low), abs(high))
    origin = ticks[len(ticks) // 2] if len(ticks) and high - low < _CLOSE * largest else 0.0
    size = max(high - low, 0.0) if origin else largest
    power = math.floor(math.log10(size)) if size > 0 else 0
    power = 0 if -3 < power < 4 else power
    axis.set_major_locator(FixedLocator(ticks.tolist()))
    if not words:
        axis.set_major_formatter(FuncFormatter(lambda x, place: ""))
        return
    axis.set_major_formatter(FuncFormatter(lambda x, place: f"{(x - origin) / 10.0**power:.4g}"))
    axis.label.set_text(_words(name, origin, power))


def _words(name: str, origin: float, power: int) -> str:
    """Return the name of a parameter and the unit of its ticks."""
    last = name.split(".")[-1]
    unit = units.meaning(last)[1]
    ten = f"10{str(power).translate(_SUPERSCRIPTS)}" if power else ""
    scaled = f"{ten} {unit}".strip()
    text = f"{name} - {origin:.9g}" if origin else name
    if origin and scaled:
        text = f"({text})"
    if not scaled:
        return text
    # A long name and its unit do not fit beside a panel.
    return f"{text}\n/ ({scaled})" if " " in scaled or "/" in scaled else f"{text}\n/ {scaled}"

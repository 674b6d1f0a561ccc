"""Meaning of the heading of a column: its words and its unit, also of standard deviations."""

from __future__ import annotations

import dataclasses
import difflib
import functools
import math
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence

from ...extend import Unit, written_unit


@dataclasses.dataclass(frozen=True)
class Meaning:
    """The recognised headings of a column: `names`, separated by commas, and the SI `unit`.

    The unit is None for labels and counts, "" for pure numbers.
    `or_unit` is an alternative unit. Numbers without a written unit whose median exceeds `usual`
    are refused; `usual_words` describe them in the message. `must_say` names units, one of which
    must be written. Without a written unit, that of the column `like` is used. `remarks`: whether
    brackets may hold text other than a unit.
    """

    names: str = ""
    unit: str | None = None
    usual: float = math.inf
    usual_words: str = ""
    must_say: str = ""
    or_unit: str | None = None
    like: str = ""
    remarks: bool = True

    @functools.cached_property
    def words(self) -> tuple[str, ...]:
        """The names in lower case, with one blank between words."""
        return tuple(map(_plain, self.names.split(","))) if self.names else ()

    def heading(self, text: str) -> Heading | None:
        """Return the heading if it has this meaning: words and unit (if any) match."""
        for words, unit in _readings(text):
            if self._matches(words) and (unit is None or self._accepts(unit)):
                return Heading(text, unit)
        # "Restitution (e)": two names of one quantity, or a remark after the name of a label.
        found = _BRACKETS.fullmatch(text.strip()) if self.remarks else None
        remark = found and self._matches(found[1]) and self.unknown_unit(text) is None
        return Heading(text) if remark else None

    def unknown_unit(self, text: str) -> str | None:
        """Return the text in brackets after matching words if it is no suitable unit."""
        found = _BRACKETS.fullmatch(text.strip())
        if found is None or self.unit is None or not self.remarks or not self._matches(found[1]):
            return None
        unit = written_unit(found[2])
        if _plain(found[2]) in self.words or (unit and self._accepts(unit)):
            return None
        # A dimensionless column may have a remark.
        return None if self.unit == "" and unit is None else found[2].strip()

    def _matches(self, text: str) -> bool:
        """Return whether the words match, in singular or plural."""
        word = _plain(text)
        return word in self.words or (len(word) > 3 and word.removesuffix("s") in self.words)

    def _accepts(self, unit: Unit) -> bool:
        return self.unit is not None and unit.si in (self.unit, self.or_unit)

    def unit_in(self, text: str) -> Unit | None:
        """Return the unit of the right kind that is written in a heading, whatever its words."""
        units = (unit for _, unit in _readings(text) if unit is not None)
        return next((unit for unit in units if self._accepts(unit)), None)


@dataclasses.dataclass(frozen=True)
class Heading:
    """A heading as written, and its unit; None without one.

    `is_time`: whether it is that of times, which may be written as mm:ss.cc.
    """

    text: str
    unit: Unit | None = None
    is_time: bool = False


_BRACKETS = re.compile(r"(.*?)\s*[\[({]([^\])}]*)[\])}]")
_BETWEEN = re.compile(r"\s*/\s*|\s*,\s*|\s+in\s+|[\s_]+")
_RATE = re.compile(r"(.+?)[\s_]+([^\s_]+)[\s_]+(?:per[\s_]+)?([^\s_]+)")


def _plain(text: str) -> str:
    """Normalise a heading: lower case, one blank between words, h₀ as h0."""
    text = unicodedata.normalize("NFKC", text).casefold()
    return re.sub(r"[\s_.\-]+", " ", text).strip()


@functools.lru_cache(1024)
def _readings(text: str) -> list[tuple[str, Unit | None]]:
    """Return the ways to read a heading: all of it as words, or its end as a unit."""
    text = text.strip()
    ways: list[tuple[str, Unit | None]] = [(text, None)]
    if (found := _BRACKETS.fullmatch(text)) and (unit := written_unit(found[2])):
        ways.append((found[1], unit))
    for between in _BETWEEN.finditer(text):
        if unit := written_unit(text[between.end() :]):
            ways.append((text[: between.start()], unit))
    if (found := _RATE.fullmatch(text)) and (unit := written_unit(f"{found[2]}/{found[3]}")):
        ways.append((found[1], unit))
    return ways


def suggestion(text: str, meanings: Mapping[str, Meaning]) -> str:
    """Return '; did you mean ...?' for a heading close to a known one, or ""."""
    known = {word: word for one in meanings.values() for word in one.words}
    known |= {_plain(name): name for name in meanings}
    stem = _plain(re.sub(r"[\[({/].*", "", text)) or _plain(text)
    near = difflib.get_close_matches(stem, [word for word in known if len(word) > 2], n=1)
    return f"; did you mean {known[near[0]]!r}?" if near and near != [stem] else ""


FROM_FILE = "errors are the standard deviations in the file"
"""The note of a recording with standard deviations."""

_BARE = (
    "sigma, σ, std, std dev, stdev, stddev, sd, standard deviation, standard uncertainty, "
    "uncertainty, ±, +/-, +-, error, err, u"
)
_BASES = f"{_BARE}, standard error, unc, s, δ, delta".split(", ")
_DEVIATION = re.compile(
    r"(σ|sigma|std\.?|st\.? ?dev|stdev|stddev|sd|standard (deviation|error|uncertainty)|"
    r"uncertainty|unc\.?|u ?\(|±|\+/-|\+-)(?![a-z]{3})|.*[\s_(](std|sd|sigma|σ|err|unc|uncertainty|"
    r"stdev|±|standard deviation)\)?$",
    re.IGNORECASE,
)


def is_bare(text: str) -> bool:
    """Return whether a heading does not name the quantity of its deviation."""
    return Meaning(_BARE, "").heading(text) is not None or Meaning(_BARE).heading(text) is not None


def deviation_of(column: str, names: Iterable[str], unit: str) -> Meaning:
    """Return the meaning of standard deviations of a `column`, also under its short `names`."""
    made = [_BARE]
    for base in _BASES:
        for name in names:
            made += [f"{base} {name}", f"{base}({name})", f"{name} {base}", f"{base} of {name}"]
            made += [f"{base}{name}"] if len(base) == 1 and base not in "su" else []
    return Meaning(", ".join(made), unit, like=column, remarks=False)


def unused_notes(names: Sequence[str], used: Mapping[str, int]) -> tuple[str, ...]:
    """Return the note on columns of standard deviations that are not used."""
    left = [
        name
        for k, name in enumerate(names)
        if k not in used.values() and _DEVIATION.match(name.replace("_", " ").strip())
    ]
    return (f"not used: {', '.join(left)}",) if left else ()

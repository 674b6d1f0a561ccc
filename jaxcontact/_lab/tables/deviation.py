"""Columns of standard deviations: recognised headings, and notes on unused columns."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

from .heading import Meaning, words

FROM_FILE = "errors are the standard deviations in the file"
"""The note of a recording with standard deviations."""

_BASES = (
    "sigma",
    "σ",
    "std",
    "std dev",
    "stdev",
    "stddev",
    "sd",
    "standard deviation",
    "standard error",
    "standard uncertainty",
    "uncertainty",
    "unc",
    "u",
    "s",
    "err",
    "error",
    "±",
    "+/-",
    "+-",
    "δ",
    "delta",
)
_BARE = words(
    "sigma, σ, std, std dev, stdev, stddev, sd, standard deviation, standard uncertainty, "
    "uncertainty, ±, +/-, +-, error, err, u"
)
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
    made = [*_BARE]
    for base in _BASES:
        for name in names:
            made += words(f"{base} {name}, {base}({name}), {name} {base}, {base} of {name}")
            made += words(f"{base}{name}") if len(base) == 1 and base not in "su" else ()
    return Meaning(tuple(dict.fromkeys(made)), unit, like=column, remarks=False)


def unused_notes(names: Sequence[str], used: Mapping[str, int]) -> tuple[str, ...]:
    """Return the note on columns of standard deviations that are not used."""
    left = [
        name
        for k, name in enumerate(names)
        if k not in used.values() and _DEVIATION.match(name.replace("_", " ").strip())
    ]
    return (f"not used: {', '.join(left)}",) if left else ()

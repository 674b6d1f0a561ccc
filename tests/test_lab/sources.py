"""The same recording as a file, an open text, a dict, arrays by keyword and data frames."""

import csv
import io

import numpy as np
import pandas as pd
import pytest

import jaxcontact as jc
from jaxcontact.lab.recordings import read_recording


class Frame:
    """As little of a data frame as is needed."""

    def __init__(self, columns):
        self._columns = columns
        self.columns = list(columns)

    def __getitem__(self, name):
        return self._columns[name]


def opened(text, name="f.csv"):
    """An open text file."""
    stream = io.StringIO(text)
    stream.name = name
    return stream


def read(text, **how):
    """The recording in the text of a CSV file that calls itself f.csv."""
    return read_recording(opened(text), **how)


def value(text):
    """What somebody would have in an array for this field."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text or None


def columns_of(text):
    """The columns of the text of a CSV file, as lists of numbers, texts and None."""
    names, *lines = csv.reader(text.split())
    return {n: [value(v) for v in c] for n, c in zip(names, zip(*lines, strict=True), strict=True)}


def by_keyword(columns, ball=None):
    assert ball is None or "ball" not in columns
    return read_recording(**columns)


SOURCES = {
    "dict": lambda columns, **how: read_recording(columns, **how),
    "arrays": lambda columns, **how: read_recording(
        {name: np.array(values) for name, values in columns.items()}, **how
    ),
    "frame": lambda columns, **how: read_recording(Frame(columns), **how),
    "pandas": lambda columns, **how: read_recording(pd.DataFrame(columns), **how),
    "nullable": lambda columns, **how: read_recording(
        pd.DataFrame(columns).convert_dtypes(), **how
    ),
    "keywords": by_keyword,
}


def refused(words, *source, **how):
    """Assert that a recording is refused with these words."""
    with pytest.raises(jc.RecordingError, match=words):
        jc.read_recording(*source, **how)

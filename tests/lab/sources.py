"""Recordings as people have them: files of all kinds, open texts, dicts, keywords, data frames."""

import csv
import io
import zipfile

import numpy as np
import pandas as pd
import pytest

import jaxcontact as jc
from jaxcontact.lab.recordings import read_recording


def german(x):
    return f"{x:g}".replace(".", ",")


def lines(head, rows, between=",", end="\n", number="{:g}".format):
    return end.join([head, *(between.join(map(number, row)) for row in rows), ""])


def workbook(*sheets):
    """A spreadsheet as openpyxl writes it; the library reads it with another one."""
    import openpyxl

    book = openpyxl.Workbook()
    book.remove(book.active)
    for name, rows in sheets:
        sheet = book.create_sheet(name)
        for row in rows:
            sheet.append(row)
    stream = io.BytesIO()
    book.save(stream)
    return stream.getvalue()


def open_document(rows):
    """A spreadsheet of LibreOffice, as small as it may be; its numbers are in German."""
    kind = "application/vnd.oasis.opendocument.spreadsheet"
    name = "urn:oasis:names:tc:opendocument:xmlns"

    def cell(value):
        is_text = isinstance(value, str)
        what = "string" if is_text else f'float" office:value="{value}'
        return (
            f'<table:table-cell office:value-type="{what}"><text:p>'
            f"{value if is_text else german(value)}</text:p></table:table-cell>"
        )

    body = "".join(f"<table:table-row>{''.join(map(cell, row))}</table:table-row>" for row in rows)
    content = (
        f'<office:document-content xmlns:office="{name}:office:1.0" '
        f'xmlns:table="{name}:table:1.0" xmlns:text="{name}:text:1.0"><office:body>'
        f'<office:spreadsheet><table:table table:name="Data">{body}</table:table>'
        "</office:spreadsheet></office:body></office:document-content>"
    )
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        file.writestr("mimetype", kind)
        file.writestr("META-INF/manifest.xml", f'<manifest xmlns="{name}:manifest:1.0"/>')
        file.writestr("content.xml", content)
    return stream.getvalue()


def parquet(columns):
    stream = io.BytesIO()
    pd.DataFrame(columns).to_parquet(stream)
    return stream.getvalue()


def written(folder, name, content):
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


class Frame:
    """As little of a data frame as is needed."""

    def __init__(self, columns):
        self._columns = columns
        self.columns = list(columns)

    def __getitem__(self, name):
        return self._columns[name]


def opened(content, name="f.csv"):
    """An open file of text, which calls itself f.csv, or of bytes."""
    if isinstance(content, bytes):
        return io.BytesIO(content)
    stream = io.StringIO(content)
    stream.name = name
    return stream


def read(content, **how):
    """The recording in such a file."""
    return read_recording(opened(content), **how)


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
    """Assert that a recording, or the file with this text, is refused with these words."""
    source = [opened(one) if isinstance(one, str | bytes) else one for one in source]
    with pytest.raises(jc.RecordingError, match=words):
        jc.read_recording(*source, **how)

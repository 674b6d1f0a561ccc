"""Recordings as people have them, as files of all kinds and open texts, and with a known truth."""

import io
import zipfile

import numpy as np
import pytest
from scipy.optimize import brentq

import jaxcontact as jc


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
    import pandas as pd

    stream = io.BytesIO()
    pd.DataFrame(columns).to_parquet(stream)
    return stream.getvalue()


def written(folder, name, content):
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def opened(content, name="f.csv"):
    """An open file of text, which calls itself f.csv, or of bytes."""
    if isinstance(content, bytes):
        return io.BytesIO(content)
    stream = io.StringIO(content)
    stream.name = name
    return stream


def read(content, **how):
    """The recording in such a file."""
    return jc.read_recording(opened(content), **how)


def refused(words, *source, **how):
    """Assert that a recording, or the file with this text, is refused with these words."""
    source = [opened(one) if isinstance(one, str | bytes) else one for one in source]
    with pytest.raises(jc.RecordingError, match=words):
        jc.read_recording(*source, **how)


# Recordings with a known truth: a ball that bounces with a given e(v), timed by noisy triggers.
# Beside it e by a method independent of the library.

GRAVITY = 9.81


def trials(law, seed, count=20, *, jitter=5e-4, scatter=0.004):
    """Intervals in s of trials of twelve flights in vacuum, the first one from 1.5 to 3 m/s.

    `law` is e(v), `jitter` the standard deviation of a trigger time in s, `scatter` that of ln e at
    a bounce.
    """
    rng, found = np.random.default_rng(seed), []
    for speed in np.linspace(1.5, 3, count):
        flights = []
        for _ in range(12):
            flights.append(2 * speed / GRAVITY)
            speed *= law(speed) * np.exp(scatter * rng.standard_normal())
        triggers = np.cumsum([0.0, *flights]) + jitter * rng.standard_normal(13)
        found.append(np.diff(triggers))
    return found


def as_csv(trials):
    """The intervals of several trials as the text of a CSV file."""
    rows = [
        f"sim,1,{number},{k},{seconds:.12g}"
        for number, intervals in enumerate(trials, 1)
        for k, seconds in enumerate(intervals, 1)
    ]
    return "\n".join(["ball,drop_height_m,trial,bounce,interval_s", *rows, ""])


def recording(law, seed, **noise):
    """Twenty such trials as CSV."""
    return as_csv(trials(law, seed, **noise))


def delivered(alpha):
    """e of a damping factor: the root of α(1+e) = ln[(1+α)/(1-αe)]."""
    if alpha == 0:
        return 1.0

    def balance(e):
        return alpha * (1 + e) - np.log1p(alpha) + np.log1p(-alpha * e)

    # e = 0 is always a root; the other lies above it and below 1/α, where the logarithm ends.
    return brentq(balance, 1e-6, min(1, 1 / alpha) * (1 - 1e-15), xtol=1e-15)


def restitution_of(law, contact):
    """e(v) of a law of the package, whose e is tested elsewhere."""
    return lambda v: float(jc.restitution(law, contact, v))

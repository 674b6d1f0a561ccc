"""A layout defined outside the package works without further changes."""

import dataclasses

import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._flight import Flight
from jaxcontact._text.words import span
from jaxcontact.lab.layouts.layout import Paired, ReadingError, Record
from jaxcontact.lab.pairs.outliers import find_outliers
from jaxcontact.lab.recordings import LAYOUTS, Layout, make_pairs, register_layout


@dataclasses.dataclass(frozen=True)
class Gate(Record):
    before: float
    after: float


class Gates(Layout):
    """Speeds in m/s that light gates read before and after an impact."""

    name = "gates"
    columns = ("operator", "drop_speed", "rebound_speed")
    measured = ("drop_speed", "rebound_speed")
    reading_error = ReadingError("m/s", "mm/s", 1e3, "each speed")
    uses_flight = False
    made_of = "readings of two gates"
    pair_words = ("pair of gates", "pairs of gates")
    cluster_words = ("operator", "operators")
    pair_rule = "each row is a pair"
    errors_words = "by operator"

    def read(self, rows):
        for row in rows:
            if row.positive("rebound_speed") > 10:
                row.refuse("rebound_speed", "is faster than the gate can read")
        return [
            Gate("", row.number, row.positive("drop_speed"), row.positive("rebound_speed"))
            for row in rows
        ]

    def facts(self, records):
        return {"speeds": span([record.before for record in records], "m/s")}

    def pair(self, records, flight):
        before, after = np.array([(r.before, r.after) for r in records]).T
        return Paired(
            velocity=before,
            restitution=after / before,
            reading_factor=before**-2 + after**-2,
            clusters=[f"operator {k % 2}" for k in range(len(records))],
            records=[(record,) for record in records],
        )

    def guess(self, records, flagged, e):
        return {int(k): "a hand in the gate" for k in np.flatnonzero(flagged)}


@pytest.fixture
def gates():
    layout = Gates()
    register_layout(layout)
    yield layout
    del LAYOUTS["gates"]


def columns(n=12):
    speed = np.linspace(1, 4, n)
    return {"drop_speed": speed, "rebound_speed": speed * (0.8 + 0.01 * np.sin(np.arange(n)))}


def test_it_is_read_and_paired(gates):
    read = columns(13)
    read["rebound_speed"][5] = 0.2
    recording = jc.read_recording(**read)
    assert recording.layout is gates
    assert "layout       gates" in repr(recording) and "speeds       1 to 4 m/s" in repr(recording)
    pairs = make_pairs(recording, Flight())
    np.testing.assert_array_equal(pairs.restitution, read["rebound_speed"] / read["drop_speed"])
    assert pairs.cluster_names == ("operator 0", "operator 1")
    assert pairs.layout.reading_error.unit == "m/s"
    assert find_outliers(pairs).guess == {5: "a hand in the gate"}


def test_its_faults_are_named(gates):
    bad = columns()
    bad["rebound_speed"][3] = 11
    with pytest.raises(jc.RecordingError, match="row 4, column rebound_speed: is faster than"):
        jc.read_recording(**bad)
    assert len(jc.read_recording(columns())) == 12
    del bad["rebound_speed"]
    with pytest.raises(
        jc.RecordingError,
        match="column rebound_speed: is missing; beside drop_speed a column rebound_speed",
    ):
        jc.read_recording(bad)
    few = make_pairs(jc.read_recording(**columns(1)), Flight())
    with pytest.raises(jc.RecordingError, match="1 usable pair of gates, but at least 4"):
        few.needs_enough()


def test_a_name_is_given_once(gates):
    with pytest.raises(ValueError, match="must have a new name, but is 'gates'"):
        register_layout(Gates())

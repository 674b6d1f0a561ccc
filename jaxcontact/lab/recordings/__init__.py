"""Recordings of bouncing balls: reading them, and pairs of speed and restitution."""

from ..layouts.heights import Heights, Peaks, Stops
from ..layouts.instants import Instants
from ..layouts.instrument import Accelerations, Forces, Indentations
from ..layouts.instrument import RecordedImpact as RecordedImpact
from ..layouts.intervals import Intervals
from ..layouts.layout import LAYOUTS as LAYOUTS
from ..layouts.layout import Layout as Layout
from ..layouts.layout import register_layout as register_layout
from ..layouts.sound import Samples
from ..layouts.speeds import RestitutionTable, Speeds
from ..layouts.track import Tracks
from ..layouts.track import tracks_of as tracks_of
from ..tables.heading import FROM_FILE as FROM_FILE
from ..tables.sheet import RecordingError as RecordingError
from .recording import RecordedPairs as RecordedPairs
from .recording import Recording as Recording
from .recording import make_pairs as make_pairs
from .recording import read_recording as read_recording
from .recording import read_recordings as read_recordings
from .table_columns import COLUMNS as COLUMNS
from .table_columns import TableColumns as TableColumns
from .table_columns import read_columns as read_columns

for _layout_class in (
    *(Intervals, Heights, Stops, RestitutionTable, Speeds),
    # With forces, y is a position on the plate; with positions, accelerations are derived.
    *(Forces, Tracks, Peaks, Accelerations, Indentations, Samples),
    # Beside any quantity measured over time, times are not bounces.
    Instants,
):
    register_layout(_layout_class())

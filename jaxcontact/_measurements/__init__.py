"""Recordings of bouncing balls: reading them, pairs of speed and restitution, noise, outliers."""

from ._columns import COLUMNS as COLUMNS
from ._columns import Columns as Columns
from ._columns import read_columns as read_columns
from ._deviation import FROM_FILE as FROM_FILE
from ._fault import RecordingError as RecordingError
from ._instants import Instants
from ._intervals import Intervals
from ._layout import LAYOUTS as LAYOUTS
from ._layout import Layout as Layout
from ._layout import register_layout as register_layout
from ._pairs import RecordedPairs as RecordedPairs
from ._pairs import make_pairs as make_pairs
from ._peaks import Peaks
from ._recording import Recording as Recording
from ._recording import read_recording as read_recording
from ._records import Accelerations, Forces, Indentations
from ._records import Impact as Impact
from ._rest import Stops
from ._samples import Samples
from ._single import Heights, Table
from ._speeds import Speeds
from ._track import Tracks
from ._track import tracks_of as tracks_of

for _layout_class in (
    *(Intervals, Heights, Stops, Table, Speeds),
    # Where forces are read, y is a place on the plate; beside places accelerations are derived.
    *(Forces, Tracks, Peaks, Accelerations, Indentations, Samples),
    # Beside anything that was measured over time, times are no bounces.
    Instants,
):
    register_layout(_layout_class())

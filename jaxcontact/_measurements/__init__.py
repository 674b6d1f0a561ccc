"""Recordings of bouncing balls: reading them, pairs of speed and restitution, noise, outliers."""

from ._recording import COLUMNS as COLUMNS
from ._recording import Recording as Recording
from ._recording import RecordingError as RecordingError
from ._recording import parse_recording as parse_recording
from ._recording import read_recording as read_recording

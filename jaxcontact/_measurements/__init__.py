from ._noise import Noise, estimate_noise
from ._outliers import THRESHOLD, Outliers, find_outliers
from ._pairs import Pairs
from ._recording import RecordingError, COLUMNS, parse_recording
from ._shim import Layout, Recording, layout_of, make_pairs, pairs_of_table, read_recording
from .._flight import Floats

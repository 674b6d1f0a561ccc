"""Tracks of a bouncing ball from video: finding impacts, and timing them between frames.

It is independent of measurements and files. `follow` is in `following`, which imports SciPy's
searches: reading tables does not wait for them.
"""

from .seen import Camera as Camera
from .seen import Drop as Drop
from .seen import Frames as Frames
from .seen import Skipped as Skipped
from .seen import Track as Track

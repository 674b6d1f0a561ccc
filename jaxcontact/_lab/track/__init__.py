"""Tracks of a bouncing ball from video: finding its impacts, and their times between frames. It
knows no measurements and no files.

`follow` stands in `_follow`, which brings SciPy's searches: what reads tables only does not wait.
"""

from .seen import Camera as Camera
from .seen import Drop as Drop
from .seen import Frames as Frames
from .seen import Skipped as Skipped
from .seen import Track as Track

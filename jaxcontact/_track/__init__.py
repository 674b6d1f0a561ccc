"""Tracks of a bouncing ball from video: finding its impacts, and their times between frames. It
knows no measurements and no files.

`follow` stands in `_follow`, which brings SciPy's searches: what reads tables only does not wait.
"""

from ._seen import Camera as Camera
from ._seen import Drop as Drop
from ._seen import Frames as Frames
from ._seen import Skipped as Skipped
from ._seen import Track as Track

"""Sound of a bouncing ball: reading it, and the times of its impacts. It knows no measurements.

`listen` stands in `_listen`, which brings SciPy's filters: what reads tables only does not wait.
"""

from .audio import SoundError as SoundError
from .audio import is_sound as is_sound
from .heard import Bounce as Bounce
from .heard import Envelope as Envelope
from .heard import Other as Other
from .heard import Sound as Sound

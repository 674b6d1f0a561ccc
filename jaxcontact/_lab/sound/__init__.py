"""Sound of a bouncing ball: reading files, and timing impacts; independent of measurements.

`listen` is in `listening`, which imports SciPy's filters: reading tables does not wait for them.
"""

from .audio import SoundError as SoundError
from .audio import is_sound as is_sound
from .heard import Envelope as Envelope
from .heard import HeardBounce as HeardBounce
from .heard import Other as Other
from .heard import Sound as Sound

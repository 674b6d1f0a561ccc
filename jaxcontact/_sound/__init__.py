"""Sound of a bouncing ball: reading it, and the times of its impacts. It knows no measurements.

`listen` stands in `_listen`, which brings SciPy's filters: what reads tables only does not wait.
"""

from ._audio import SoundError as SoundError
from ._audio import is_sound as is_sound
from ._heard import Bounce as Bounce
from ._heard import Envelope as Envelope
from ._heard import Other as Other
from ._heard import Sound as Sound

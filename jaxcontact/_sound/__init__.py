"""Sound of a bouncing ball: reading it, and the times of its impacts. It knows no measurements."""

from ._audio import SoundError as SoundError
from ._audio import is_sound as is_sound
from ._listen import Bounce as Bounce
from ._listen import Other as Other
from ._listen import Sound as Sound
from ._listen import listen as listen
from ._rises import Envelope as Envelope

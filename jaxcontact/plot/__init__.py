"""Pictures: every function draws on the axes it is given, or on new ones, and returns them."""

from ._animate import animate as animate
from ._calibration import calibration as calibration
from ._choice import choice as choice
from ._corner import corner as corner
from ._energy import energy as energy
from ._fit import fit as fit
from ._impact import impact as impact
from ._law import law as law
from ._profile import profile as profile
from ._record import record as record
from ._residuals import residuals as residuals
from ._save import save as save
from ._scene import scene as scene
from ._sound import sound as sound
from ._sweep import sweep as sweep
from ._track import track as track
from ._trajectory import trajectory as trajectory

"""Motions solved until an event ends them: fields and guards in, the end out."""

from .field import Field as Field
from .field import Flags as Flags
from .field import Moment as Moment
from .field import Packed as Packed
from .field import Record as Record
from .field import chosen as chosen
from .field import in_time as in_time
from .landing import land as land
from .march import Marched as Marched
from .march import Tolerance as Tolerance
from .march import march as march

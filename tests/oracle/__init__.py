"""Independent 40-digit results for one impact, which share no formula and no code with the library.

``cases("hunt_crossley")`` reads the stored answers; the functions compute new ones. ``python -m
tests.oracle.generate`` regenerates the file.
"""

from tests.oracle._impacts import (
    DIGITS,
    FIELDS,
    Impact,
    derivative,
    hunt_crossley,
    hunt_crossley_by_motion,
    kuwabara_kono,
    oscillator,
    with_gravity,
)
from tests.oracle._reference import REFERENCE_FILE, Case, cases

__all__ = [
    "DIGITS", "FIELDS", "REFERENCE_FILE", "Case", "Impact", "cases", "derivative", "hunt_crossley",
    "hunt_crossley_by_motion", "kuwabara_kono", "oscillator", "with_gravity",
]  # fmt: skip

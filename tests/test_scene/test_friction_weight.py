"""A scene without friction compiles nothing for it."""

import pytest

from benchmarks.weight import PROGRAMS, counted_here, imported, weight

BEFORE = {
    "scene of 3 discs and a plane, instantaneous": (3_247, 6),
    "scene of 3 discs and a plane, soft": (11_809, 6),
    "scene with a moving wall": (3_978, 6),
}
"""Instructions and programs of first calls, counted before scenes had friction."""

MORE = 3
"""A comparison has come with the events of stick and slip, in the loop of soft contacts, and three
instructions with the ending of an instantaneous run whose law gives no e.
"""


@pytest.mark.skipif(not counted_here(), reason="instructions are counted at other versions")
def test_scenes_without_friction_are_as_light_as_before():
    with imported() as run:
        for name, (instructions, programs) in BEFORE.items():
            found = weight(PROGRAMS[name], run)
            assert found["instructions"] <= instructions + MORE, (name, found)
            assert found["programs"] <= programs, (name, found)

"""Every public callable with its cases, and the exempt ones."""

import functools

from tests.test_every_argument import fits, friction, measured, physics, results, scenes, systems


@functools.cache
def cases():
    rooms = (physics, fits, measured, results, scenes, systems, friction)
    every = [case for room in rooms for case in room.cases()]
    assert len({case.label for case in every}) == len(every)
    return {case.label: case for case in every}

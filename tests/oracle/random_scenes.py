"""Random discs in a box under gravity, and their final state by Newton's equations.

The answers of up to a thousand scenes are stored. ``python -m tests.oracle.random_scenes`` computes
the missing ones (by ``many_discs``, without ``jaxcontact``; half an hour on one free core).
"""

import functools
import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.oracle.many_discs import Discs, followed
from tests.oracle.scene_oracle import Ball, Spring, Wall

ANSWERS = Path(__file__).with_name("random_scenes.json")
COUNT, PIECE = 1000, 100
"""How many there are, and how many are solved at once and then stored."""
LAWS = "hunt_crossley", "flores", "kuwabara_kono", "antypov_elliott", "kelvin_voigt"
ALIKE = tuple(k for k in range(250) if k % len(LAWS) < 2 and k // len(LAWS) % 2)
"""Fifty with four discs and a law of Hunt and Crossley's family."""
GRAVITY = (0.0, -9.81)
DURATION = 0.5
"""In s: some ten touches."""
NUDGE = 1e-7
"""The change of the start, in m and m/s, that tells how a run magnifies one."""
RTOL, NUDGED = 1e-13, 1e-10
"""Of the integration, and where the start is changed."""
MOST = 4


@dataclass(frozen=True)
class RandomScene:
    """Discs between 0 and 1 m along both axes; ``number`` is the law's e, or its A in s."""

    law: str
    number: float
    stiffness: float
    balls: tuple[Ball, ...]

    @property
    def exponent(self) -> float:
        return 1.0 if self.law == "kelvin_voigt" else 1.5

    @property
    def tension(self) -> bool:
        return self.law not in ("hunt_crossley", "flores")

    @property
    def damping(self) -> dict[str, float]:
        """The law written out: alpha, A, or c beside the root of the effective mass."""
        k, e = self.stiffness, self.number
        if self.law == "hunt_crossley":
            return {"alpha": 1.5 * (1 - e)}
        if self.law == "flores":
            return {"alpha": 8 * (1 - e) / (5 * e)}
        if self.law == "kuwabara_kono":
            return {"A": self.number}
        ratio = -math.log(e) / math.hypot(math.pi, math.log(e))
        return {"c": math.sqrt(2 * (self.exponent + 1)) * ratio * math.sqrt(k)}

    @property
    def walls(self) -> list[Wall]:
        """In the order of the faces of a box, for ``scene_oracle``."""
        return [
            Wall(point, normal)
            for axis in ((1.0, 0.0), (0.0, 1.0))
            for point, normal in (((0.0, 0.0), axis), ((1.0, 1.0), (-axis[0], -axis[1])))
        ]

    def spring(self, i: int, j: int) -> Spring:
        """For ``scene_oracle``, which has no law of Kuwabara and Kono."""
        masses = [ball.mass for ball in self.balls] + [math.inf] * 4
        root = (1 / (1 / masses[i] + 1 / masses[j])) ** 0.5
        given = self.damping | {"exponent": self.exponent, "tension": self.tension}
        if "c" in given:
            given["c"] *= root
        return Spring(self.stiffness, **given)


def drawn(number: int) -> RandomScene:
    """One of the scenes: each law in turn, with three discs, then with four."""
    random = np.random.default_rng([38, number])
    law = LAWS[number % len(LAWS)]
    count = MOST - 1 + number // len(LAWS) % 2
    e, low = random.uniform(0.3, 0.95), 4.0 if law == "kelvin_voigt" else 5.0
    stiffness = 10 ** random.uniform(low, low + 2)
    if law == "kuwabara_kono":
        # Chosen so that an impact of 1 kg at 2 m/s has about this e.
        e = (1 - e) / 2 * (1 / stiffness) ** 0.4 * 2**-0.2
    balls: list[Ball] = []
    while len(balls) < count:
        radius = random.uniform(0.08, 0.13)
        place = random.uniform(radius + 0.01, 0.99 - radius, 2)
        apart = [math.dist(place, ball.position) - ball.radius - radius for ball in balls]
        if min(apart, default=1.0) > 0.01:
            velocity = random.normal(0, 1.5, 2)
            mass = 10 ** random.uniform(-0.3, 0.5)
            balls.append(Ball(place.tolist(), velocity.tolist(), radius, mass))
    return RandomScene(law, e, stiffness, tuple(balls))


def _discs(scenes: list[RandomScene], seed: int | None) -> Discs:
    """All scenes with the same number of discs; with a ``seed``, their starts changed a little."""
    lanes = len(scenes)
    place, speed = np.zeros((2, lanes, MOST, 2))
    radius, mass = np.zeros((lanes, MOST)), np.ones((lanes, MOST))
    # Unused bodies fall without touching anything.
    place[:] = 0.5 + 2 * np.arange(MOST)[:, None]
    for k, scene in enumerate(scenes):
        for i, ball in enumerate(scene.balls):
            place[k, i], speed[k, i] = ball.position, ball.velocity
            radius[k, i], mass[k, i] = ball.radius, ball.mass
    if seed is not None:
        change = np.random.default_rng(seed).normal(0, NUDGE, (2, *place.shape))
        place, speed = place + change[0], speed + change[1]

    def each(name: str) -> np.ndarray:
        return np.array([scene.damping.get(name, 0.0) for scene in scenes])

    return Discs(
        *(place, speed, radius, mass),
        stiffness=np.array([scene.stiffness for scene in scenes]),
        exponent=np.array([scene.exponent for scene in scenes]),
        **{name: each(name) for name in ("alpha", "c", "A")},
        tension=np.array([scene.tension for scene in scenes]),
    )


def _joined(starts: list[Discs]) -> Discs:
    names = [name for name in vars(starts[0]) if name != "weight"]
    return Discs(**{n: np.concatenate([getattr(s, n) for s in starts]) for n in names})


def solved(numbers: list[int]) -> dict[str, dict]:
    """The answers of some scenes: positions in m and velocities in m/s at the end, the number of
    touches, and by how much the run magnifies a small change of its start.
    """
    scenes = [drawn(number) for number in numbers]
    starts = [_discs(scenes, seed) for seed in (None, 1, 2)]
    rtol = np.repeat([RTOL, NUDGED, NUDGED], len(scenes))
    ends = followed(_joined(starts), DURATION, rtol)
    (position, *x), (velocity, *v), (touches, *_) = (np.split(end, len(starts)) for end in ends)
    there, growth = starts[0].radius[..., None] > 0, np.ones(len(scenes))
    for place, speed in zip(x, v, strict=True):
        moved = np.maximum(np.abs(place - position), np.abs(speed - velocity))
        moved = np.max(np.where(there, moved, 0), axis=(1, 2))
        growth = np.maximum(growth, moved / NUDGE)

    def rounded(rows: np.ndarray) -> list[list[float]]:
        return [[float(f"{x:.14g}") for x in row] for row in rows]

    return {
        str(number): {
            "position": rounded(position[k, : len(scenes[k].balls)]),
            "velocity": rounded(velocity[k, : len(scenes[k].balls)]),
            "touches": int(touches[k]),
            "growth": float(f"{growth[k]:.3g}"),
        }
        for k, number in enumerate(numbers)
    }


@functools.cache
def answers() -> dict[str, dict]:
    """Those that are stored, by the number of the scene."""
    return json.loads(ANSWERS.read_text()) if ANSWERS.exists() else {}


def main() -> None:
    found = answers()
    # Scenes used by tests come first.
    order = [*ALIKE, *(k for k in range(COUNT) if k not in ALIKE)]
    while missing := [k for k in order if str(k) not in found][:PIECE]:
        found |= solved(missing)
        rows = (f'"{k}": {json.dumps(found[k])}' for k in sorted(found, key=int))
        ANSWERS.write_text("{\n" + ",\n".join(rows) + "\n}\n")
        print(len(found), flush=True)


if __name__ == "__main__":
    main()

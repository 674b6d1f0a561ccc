"""Random discs in a box under gravity, and their final state by Newton's equations.

The answers of up to a thousand scenes are stored. ``python -m tests.oracle.random_scenes`` computes
the missing ones by ``scene_oracle``, in some three seconds each. Those of today come from another
program; the two agree to 1e-11 times the growth of a run.
"""

import dataclasses
import functools
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.oracle.scene_oracle import Ball, Run, Spring, Wall, run

ANSWERS = Path(__file__).with_name("random_scenes.json")
COUNT = 1000
LAWS = "hunt_crossley", "flores", "kuwabara_kono", "antypov_elliott", "kelvin_voigt"
ALIKE = tuple(k for k in range(250) if k % len(LAWS) < 2 and k // len(LAWS) % 2)
"""Fifty with four discs and a law of Hunt and Crossley's family."""
GRAVITY = (0.0, -9.81)
DURATION = 0.5  # in s: some ten touches
NUDGE = 1e-7  # the change of the start, in m and m/s, that tells how a run magnifies one


@dataclass(frozen=True)
class Viscous(Spring):
    """The force of a spring, and K n A d^(n-1) d'."""

    A: float = 0.0

    def force(self, depth: float, rate: float, speed: float) -> float:
        damping = self.A * self.exponent * max(depth, 0.0) ** (self.exponent - 1)
        return super().force(depth, rate, speed) + self.stiffness * damping * rate


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
        masses = [ball.mass for ball in self.balls] + [math.inf] * 4
        root = (1 / (1 / masses[i] + 1 / masses[j])) ** 0.5
        given = self.damping | {"exponent": self.exponent, "tension": self.tension}
        if "c" in given:
            given["c"] *= root
        return Viscous(self.stiffness, **given)


def drawn(number: int) -> RandomScene:
    """One of the scenes: each law in turn, with three discs, then with four."""
    random = np.random.default_rng([38, number])
    law = LAWS[number % len(LAWS)]
    count = 3 + number // len(LAWS) % 2
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


def solved(scene: RandomScene) -> dict[str, Any]:
    """The answer: positions in m and velocities in m/s at the end, the number of touches, and by
    how much the run magnifies a small change of its start.
    """

    def ended(balls: Sequence[Ball]) -> Run:
        return run(balls, scene.spring, DURATION, scene.walls, GRAVITY)

    def rounded(rows: np.ndarray) -> list[list[float]]:
        return [[float(f"{x:.14g}") for x in row] for row in rows]

    end, growth = ended(scene.balls), 1.0
    for seed in (1, 2):
        change = np.random.default_rng(seed).normal(0, NUDGE, (len(scene.balls), 2, 2))
        nudged = ended(
            [
                dataclasses.replace(ball, position=ball.position + x, velocity=ball.velocity + v)
                for ball, (x, v) in zip(scene.balls, change, strict=True)
            ]
        )
        moved = nudged.position - end.position, nudged.velocity - end.velocity
        growth = max(growth, np.abs(moved).max() / NUDGE)
    return {
        "position": rounded(end.position),
        "velocity": rounded(end.velocity),
        "touches": len(end.touches),
        "growth": float(f"{growth:.3g}"),
    }


@functools.cache
def answers() -> dict[str, dict]:
    """Those that are stored, by the number of the scene."""
    return json.loads(ANSWERS.read_text()) if ANSWERS.exists() else {}


def main() -> None:
    found = answers()
    # Scenes used by tests come first.
    order = [*ALIKE, *(k for k in range(COUNT) if k not in ALIKE)]
    for number in (k for k in order if str(k) not in found):
        found[str(number)] = solved(drawn(number))
        rows = (f'"{k}": {json.dumps(found[k])}' for k in sorted(found, key=int))
        ANSWERS.write_text("{\n" + ",\n".join(rows) + "\n}\n")
        print(len(found), flush=True)


if __name__ == "__main__":
    main()

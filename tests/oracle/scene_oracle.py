"""Scenes by brute force: Newton's equations of all bodies by SciPy's DOP853, restarted at events.

Nothing of ``jaxcontact`` is imported. Indentations are integrated as changes since the last
restart, because differences of positions would have few digits. Restarts are located by bisection
on fresh integrations, not on the interpolant.
"""

import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq

from tests.oracle.stored import stored

RTOL = 1e-13


@dataclass(frozen=True)
class Ball:
    """A sphere; infinite ``mass`` for a fixed one."""

    position: Sequence[float]
    velocity: Sequence[float]
    radius: float = 0.5
    mass: float = 1.0


@dataclass(frozen=True)
class Wall:
    """A plane through ``point``, its ``normal`` on the free side, at a constant ``velocity``."""

    point: Sequence[float]
    normal: Sequence[float]
    velocity: Sequence[float] | None = None


@dataclass(frozen=True)
class Spring:
    """K d^n (1 + alpha d'/v0) + c d^((n-1)/2) d', clamped at zero unless it has ``tension``."""

    stiffness: float
    exponent: float = 1.5
    alpha: float = 0.0
    c: float = 0.0
    tension: bool = False

    def elastic(self, depth: float) -> float:
        return self.stiffness * max(depth, 0.0) ** self.exponent

    def force(self, depth: float, rate: float, speed: float) -> float:
        depth = max(depth, 0.0)
        ratio = 0.0 if self.alpha == 0 or speed == 0 else rate / speed
        total = self.elastic(depth) * (1 + self.alpha * ratio)
        if self.c:
            total += self.c * depth ** ((self.exponent - 1) / 2) * rate
        return total if self.tension else max(total, 0.0)


@dataclass
class Touch:
    """One contact from touch to zero indentation; ``end`` is None where it lasts to the end."""

    pair: tuple[int, int]
    begin: float
    speed: float
    end: float | None = None
    latched: float = 0.0
    max_force: float = 0.0
    lost: float = 0.0


@dataclass
class Run:
    """Where everything is at the end, and every contact in the order of the touches."""

    time: float
    position: np.ndarray
    velocity: np.ndarray
    touches: list[Touch] = field(default_factory=list)


def run(
    balls: Sequence[Ball],
    spring: Spring | Callable[[int, int], Spring],
    duration: float = np.inf,
    walls: Sequence[Wall] = (),
    gravity: Sequence[float] | None = None,
    v0: str | float = "peak",
    closed: Sequence[tuple[int, int]] = (),
    until_apart: bool = False,
    period: float = np.inf,
) -> Run:
    """The scene after ``duration``, or when ``until_apart`` all contacts are over.

    Walls are numbered after the balls. Balls whose gap is within 1e-12 of a radius and who do not
    recede touch at the start; ``closed`` names pairs that do whatever their gap says. With a
    ``period`` balls meet in their nearest images along all axes.
    """
    count = len(balls)
    pairs = [(i, j) for i in range(count) for j in range(i + 1, count + len(walls))]
    springs = {pair: spring(*pair) if callable(spring) else spring for pair in pairs}
    return _run(balls, springs, duration, walls, gravity, v0, closed, until_apart, period)


@stored()
def _run(balls, springs, duration, walls, gravity, v0, closed, until_apart, period):
    scene = _Scene(balls, springs, walls, gravity, v0, closed, period)
    return scene.run(duration, until_apart)


def _dot(a, b) -> float:
    return sum(map(operator.mul, a, b))


class _Scene:
    def __init__(self, balls, springs, walls, gravity, v0, closed, period):
        self.n, self.dim = len(balls), len(balls[0].position)
        self.balls, self.walls, self.v0, self.period = balls, walls, v0, period
        self.pairs = [(i, j) for i in range(self.n) for j in range(i + 1, self.n)]
        self.pairs = [p for p in self.pairs if not all(np.isinf(balls[k].mass) for k in p)]
        self.pairs += [
            (i, self.n + k)
            for i in range(self.n)
            for k in range(len(walls))
            if np.isfinite(balls[i].mass)
        ]
        self.springs = [springs[p] for p in self.pairs]
        self.x = np.array([b.position for b in balls], float)
        self.v = np.array([b.velocity for b in balls], float)
        self.inverse = [1 / b.mass for b in balls]
        g = np.zeros(self.dim) if gravity is None else np.asarray(gravity, float)
        self.g = np.where(np.array(self.inverse)[:, None] > 0, g, 0.0)
        self.t = 0.0
        self.depth = [float(self._gap(p)) for p in self.pairs]
        self.closed = [False] * len(self.pairs)
        self.rising = [False] * len(self.pairs)
        self.latched = [0.0] * len(self.pairs)
        self.touches: list[Touch] = []
        self.current: list[Any] = [None] * len(self.pairs)
        self.facing = [[x.tolist() for x in self._wall(self.n + k)[1:]] for k in range(len(walls))]
        self.pulled = self.g.ravel().tolist()
        self._restart()
        rates = self._geometry(self._state().tolist(), 0.0)[1]
        for k, p in enumerate(self.pairs):
            near = abs(self.depth[k]) <= 1e-12 * self._radius(p)
            if p in closed or (near and rates[k] >= 0):
                self.depth[k] = 0.0
                self._touch(k, rates[k])

    def _restart(self):
        """Where the pairs of balls stand to each other, from which they move."""
        pairs = [(i, j) for i, j in self.pairs if j < self.n]
        before = {(i, j): self._apart(i, j).tolist() for i, j in pairs}
        self.before = [before.get(pair) for pair in self.pairs]
        if np.isfinite(self.period):
            for k, pair in enumerate(self.pairs):
                if not self.closed[k] and abs(self._gap(pair) - self.depth[k]) > 1e-6:
                    # Another image is now the nearest.
                    self.depth[k] = float(self._gap(pair))

    def _state(self):
        """No displacement, the velocities, and no energy lost."""
        return np.concatenate([0 * self.v.ravel(), self.v.ravel(), np.zeros(len(self.pairs))])

    def _apart(self, i, j):
        away = self.x[i] - self.x[j]
        return away if np.isinf(self.period) else away - self.period * np.round(away / self.period)

    def _radius(self, pair) -> float:
        return self.balls[pair[0]].radius

    def _wall(self, j) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        w = self.walls[j - self.n]
        n = np.asarray(w.normal, float)
        speed = np.zeros(self.dim) if w.velocity is None else np.asarray(w.velocity, float)
        return np.asarray(w.point, float), n / np.linalg.norm(n), speed

    def _gap(self, pair) -> float:
        i, j = pair
        if j < self.n:
            touching = self.balls[i].radius + self.balls[j].radius
            return touching - np.linalg.norm(self._apart(i, j))
        point, normal, speed = self._wall(j)
        return self.balls[i].radius - normal @ (self.x[i] - point - speed * self.t)

    def _geometry(self, y, dt):
        """Indentations, their rates, normals (on the first body) and tangential speed squared over
        distance, for displacements and velocities since the restart ``dt`` ago.

        Of numbers, not of arrays, which take five times as long where they are so short.
        """
        m, dim = self.n * self.dim, self.dim
        depths, rates, normals, swirls = [], [], [], []
        for k, (i, j) in enumerate(self.pairs):
            a, b = i * dim, j * dim
            s, v = y[a : a + dim], y[m + a : m + a + dim]
            if j < self.n:
                before = self.before[k]
                change = [p - q for p, q in zip(s, y[b : b + dim], strict=True)]
                relative = [p - q for p, q in zip(v, y[m + b : m + b + dim], strict=True)]
                now = [p + q for p, q in zip(before, change, strict=True)]
                length, start = math.sqrt(_dot(now, now)), math.sqrt(_dot(before, before))
                normal = [x / length for x in now]
                further = [2 * p + q for p, q in zip(before, change, strict=True)]
                rate = -_dot(normal, relative)
                across = [p + rate * q for p, q in zip(relative, normal, strict=True)]
                depths.append(self.depth[k] - _dot(further, change) / (length + start))
                swirls.append(_dot(across, across) / length)
            else:
                normal, speed = self.facing[j - self.n]
                moved = [p - q * dt for p, q in zip(s, speed, strict=True)]
                rate = -_dot(normal, [p - q for p, q in zip(v, speed, strict=True)])
                depths.append(self.depth[k] - _dot(normal, moved))
                swirls.append(0.0)
            rates.append(rate)
            normals.append(normal)
        return depths, rates, normals, swirls

    def _speed(self, k, rate) -> float:
        return rate if self.rising[k] else self.latched[k]

    def _all(self, dt, y):
        """Slopes of the state, indentations, their first and second rates, and forces."""
        y = y.tolist()
        m, dim = self.n * self.dim, self.dim
        depth, rate, normal, swirl = self._geometry(y, dt)
        a = self.pulled[:]
        forces, losses = [0.0] * len(self.pairs), [0.0] * len(self.pairs)
        for k, (i, j) in enumerate(self.pairs):
            if not self.closed[k]:
                continue
            spring = self.springs[k]
            force = spring.force(depth[k], rate[k], self._speed(k, rate[k]))
            forces[k] = force
            losses[k] = (force - spring.elastic(depth[k])) * rate[k]
            for c in range(dim):
                a[i * dim + c] += force * normal[k][c] * self.inverse[i]
                if j < self.n:
                    a[j * dim + c] -= force * normal[k][c] * self.inverse[j]
        second = []
        for k, (i, j) in enumerate(self.pairs):
            relative = a[i * dim : (i + 1) * dim]
            if j < self.n:
                relative = [p - q for p, q in zip(relative, a[j * dim :][:dim], strict=True)]
            second.append(-_dot(normal[k], relative) - swirl[k])
        return np.array(y[m : 2 * m] + a + losses), depth, rate, second, forces

    def _events(self, dt, y) -> list[tuple[int, str, float]]:
        """The events that the state has passed: pair, kind and by how much (negative)."""
        _, depth, rate, second, _ = self._all(dt, y)
        found = []
        for k in range(len(self.pairs)):
            if not self.closed[k]:
                if depth[k] > 0 and rate[k] > 0:
                    found.append((k, "touch", -depth[k]))
                continue
            if depth[k] < 0 and rate[k] < 0:
                found.append((k, "part", depth[k]))
            if self.v0 == "peak" and self.springs[k].alpha:
                if self.rising[k] and second[k] < 0:
                    found.append((k, "latch", second[k]))
                if not self.rising[k] and rate[k] > self.latched[k] and second[k] > 0:
                    found.append((k, "rise", self.latched[k] - rate[k]))
        return found

    def _gap_of(self, k, kind, dt, y) -> float:
        _, depth, rate, second, _ = self._all(dt, y)
        match kind:
            case "touch":
                return -depth[k]
            case "part":
                return depth[k]
            case "latch":
                return second[k]
            case _:
                return self.latched[k] - rate[k]

    def _touch(self, k, rate):
        self.closed[k] = True
        self.latched[k] = max(rate, 0.0)
        if not isinstance(self.v0, str):
            self.latched[k] = max(rate, self.v0)
        self.current[k] = Touch(self.pairs[k], self.t, rate)
        self.touches.append(self.current[k])

    def _units(self) -> tuple[float, float, float]:
        relative = [self.v - w for w in self.v]
        speed = max(np.abs(relative).max(), np.linalg.norm(self.g[0]) * 1e-3, 1e-9)
        for i in range(len(self.walls)):
            speed = max(speed, np.abs(self.v - self._wall(self.n + i)[2]).max())
        masses = [b.mass for b in self.balls if np.isfinite(b.mass)]
        spring = max(self.springs, key=lambda s: s.stiffness)
        length = (min(masses) * speed**2 / spring.stiffness) ** (1 / (spring.exponent + 1))
        return speed, length, length / speed

    def run(self, duration, until_apart) -> Run:
        while self.t < duration and (any(self.closed) or not until_apart):
            left, images = duration - self.t, self._images_for()
            if not self._to_next_event(min(left, images)) and left <= images:
                break
        for k, touch in enumerate(self.current):
            if touch is not None:
                touch.latched = self.latched[k]
        return Run(self.t, self.x, self.v, self.touches)

    def _images_for(self) -> float:
        """How long no two balls can meet in other images than those that are nearest now."""
        largest = max(ball.radius for ball in self.balls)
        fastest = np.linalg.norm(self.v, axis=1).max() + self._units()[0]
        return (self.period / 2 - 2 * largest) / (4 * fastest)

    def _to_next_event(self, left) -> bool:
        """Integrate for the time left or up to the next event; whether there was one."""
        speed, length, tick = self._units()
        m, pairs = self.n * self.dim, len(self.pairs)
        energy = speed**2 * min(b.mass for b in self.balls)
        sizes = np.repeat([length, speed, energy], [m, m, pairs])
        options = {"rtol": RTOL, "atol": RTOL * sizes}

        def fun(dt, y):
            return self._all(dt, y)[0]

        def after(start, y, end):
            """The state at ``end``, from the state at ``start`` by a solve of its own."""
            if end <= start:
                return y
            inner = DOP853(fun, start, y, end, first_step=(end - start) / 4, **options)
            while inner.status == "running":
                inner.step()
            return inner.y

        y = self._state()
        solver = DOP853(fun, 0.0, y, left, first_step=min(1e-5 * tick, left), **options)
        passed: list[tuple[int, str, float]] = []
        start, before = 0.0, y
        while solver.status == "running" and not passed:
            start, before = solver.t, solver.y
            solver.max_step = self._most(before, start, tick)
            solver.step()
            self._record_force(solver)
            passed = self._events(solver.t, solver.y)
        dt, y = solver.t, solver.y
        moments = []
        for k, kind, _ in passed:

            def gap(at, k=k, kind=kind):
                return self._gap_of(k, kind, at, after(start, before, at))

            at = start
            if gap(start) > 0:
                at = brentq(gap, start, solver.t, xtol=1e-15 * tick, rtol=1e-15)
            moments.append((at, k, kind))
        if passed:
            dt = min(moments)[0]
            y = after(start, before, dt)
        self._move(dt, y)
        rate = self._all(0.0, self._state())[2]
        for at, k, kind in moments:
            if at <= dt + 1e-14 * tick:
                self._happens(k, kind, rate[k])
        return bool(passed)

    def _move(self, dt, y):
        """Restart from a state."""
        m = self.n * self.dim
        depth = self._all(dt, y)[1]
        self.t += dt
        self.x = self.x + y[:m].reshape(self.n, self.dim)
        self.v = y[m : 2 * m].reshape(self.n, self.dim).copy()
        self.depth = depth
        self._restart()
        for k, touch in enumerate(self.current):
            if touch is not None:
                touch.lost += y[2 * m + k]

    def _happens(self, k, kind, rate):
        if kind in ("touch", "part"):
            self.depth[k] = 0.0
        if kind == "touch":
            self._touch(k, rate)
        elif kind == "part":
            self.closed[k] = self.rising[k] = False
            self.current[k].end, self.current[k].latched = self.t, self.latched[k]
            self.current[k] = None
        elif kind == "latch":
            self.rising[k], self.latched[k] = False, rate
        else:
            self.rising[k] = True

    def _most(self, y, dt, tick) -> float:
        """A step that no contact fits into."""
        if any(self.closed):
            return 0.2 * tick
        depth = self._geometry(y.tolist(), dt)[0]
        v = y[self.n * self.dim :][: self.n * self.dim].reshape(self.n, self.dim)
        fastest = 2 * np.linalg.norm(v, axis=1).max() + 1e-300
        return max(0.2 * tick, 0.5 * min(map(abs, depth)) / fastest)

    def _record_force(self, solver):
        if solver.t_old is None or not any(self.closed):
            return
        dense = solver.dense_output()
        for dt in np.linspace(solver.t_old, solver.t, 5):
            force = self._all(dt, dense(dt))[4]
            for k, touch in enumerate(self.current):
                if touch is not None:
                    touch.max_force = max(touch.max_force, force[k])

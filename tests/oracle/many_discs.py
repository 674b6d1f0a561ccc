"""Many scenes of discs in boxes at once: Newton's equations by DOP853 in NumPy, with restarts.

Each lane has its own steps. A step beyond an event is repeated, up to the event, by a secant.
Nothing of ``jaxcontact`` is imported, nor of ``scene_oracle``.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate._ivp import dop853_coefficients as dop853

STAGES = dop853.N_STAGES


@dataclass(frozen=True)
class Discs:
    """S scenes of N discs between 0 and 1 m along both axes, under a weight in m/s².

    A disc that a scene does not have has no ``radius``. The force of a pair is

        K d^n (1 + alpha d'/v0) + c sqrt(m) d^((n-1)/2) d' + K n A d^(n-1) d',

    with the effective mass m and n = 3/2 or 1; v0 is the largest closing speed since touch. Without
    ``tension`` it is clamped at zero.
    """

    position: np.ndarray
    velocity: np.ndarray
    radius: np.ndarray
    mass: np.ndarray
    stiffness: np.ndarray
    exponent: np.ndarray
    alpha: np.ndarray
    c: np.ndarray
    A: np.ndarray
    tension: np.ndarray
    weight: float = 9.81

    def some(self, lanes: np.ndarray) -> "Discs":
        given = {k: v[lanes] for k, v in vars(self).items() if k != "weight"}
        return Discs(**given, weight=self.weight)


@dataclass
class _State:
    """Of every lane: time, positions and velocities, and of its pairs whether they are closed, and
    whether v0 is the closing speed or the one that is latched.
    """

    t: np.ndarray
    y: np.ndarray
    closed: np.ndarray
    rising: np.ndarray
    latched: np.ndarray


class _Equations:
    """The equations of motion of some lanes; pairs of discs come first, then those with walls."""

    def __init__(self, discs: Discs):
        self.discs, self.n = discs, discs.position.shape[1]
        self.i, self.j = np.triu_indices(self.n, 1)
        there = discs.radius > 0
        walls = np.repeat(there, 4, axis=1)
        self.used = np.concatenate([there[:, self.i] & there[:, self.j], walls], axis=1)
        inverse = 1 / discs.mass
        self.inverse = inverse[..., None]
        mass = 1 / np.concatenate(
            [inverse[:, self.i] + inverse[:, self.j], np.repeat(inverse, 4, axis=1)], axis=1
        )
        self.viscous = discs.c[:, None] * np.sqrt(mass)
        self.linear = (discs.exponent == 1)[:, None]
        self.distance = discs.radius[:, self.i] + discs.radius[:, self.j]

    def motion(self, y, closed, rising, latched):
        """Slopes of the state; indentations, closing speeds and their rates."""
        d, n = self.discs, self.n
        x, v = y[:, : 2 * n].reshape(-1, n, 2), y[:, 2 * n :].reshape(-1, n, 2)
        apart, relative = x[:, self.i] - x[:, self.j], v[:, self.i] - v[:, self.j]
        length = np.sqrt(np.sum(apart * apart, axis=-1))
        length = np.where(self.used[:, : len(self.i)], length, 1)
        normal = apart / length[..., None]
        away = np.sum(normal * relative, axis=-1)
        across = np.sum(relative * relative, axis=-1) - away * away
        r = d.radius[..., None]
        # Lower and upper limits of every disc along both axes.
        walls = np.stack([r - x, x - 1 + r], axis=-1).reshape(len(y), -1)
        onto = np.stack([-v, v], axis=-1).reshape(len(y), -1)
        depth = np.concatenate([self.distance - length, walls], axis=1)
        rate = np.concatenate([-away, onto], axis=1)
        force = self.force(np.maximum(depth, 0), rate, np.where(rising, rate, latched))
        force = np.where(closed, force, 0)
        push = force[:, : len(self.i), None] * normal
        total = np.zeros_like(x)
        for k, (i, j) in enumerate(zip(self.i, self.j, strict=True)):
            total[:, i] += push[:, k]
            total[:, j] -= push[:, k]
        faces = force[:, len(self.i) :].reshape(-1, n, 2, 2)
        total += faces[..., 0] - faces[..., 1]
        a = total * self.inverse
        a[..., 1] -= d.weight
        bend = -np.sum(normal * (a[:, self.i] - a[:, self.j]), axis=-1) - across / length
        second = np.concatenate([bend, np.stack([-a, a], axis=-1).reshape(len(y), -1)], axis=1)
        slope = np.concatenate([v.reshape(len(y), -1), a.reshape(len(y), -1)], axis=1)
        return slope, depth, rate, second

    def force(self, depth, rate, speed):
        d = self.discs
        root = np.sqrt(depth)
        k, linear = d.stiffness[:, None], self.linear
        ratio = np.where(speed > 0, rate / np.where(speed > 0, speed, 1), 0)
        total = k * np.where(linear, depth, depth * root) * (1 + d.alpha[:, None] * ratio)
        total = total + self.viscous * np.where(linear, 1, np.sqrt(root)) * rate
        total = total + k * d.A[:, None] * np.where(linear, 1, 1.5 * root) * rate
        return np.where(d.tension[:, None], total, np.maximum(total, 0))

    def units(self, y):
        """Speeds and lengths of contacts, about."""
        d, n = self.discs, self.n
        v = y[:, 2 * n :].reshape(-1, n, 2)
        fast = np.max(np.sqrt(np.sum(v * v, axis=-1)), axis=1)
        speed = np.maximum(2 * fast, 0.01)
        mass = np.min(np.where(d.radius > 0, d.mass, np.inf), axis=1)
        return speed, (mass * speed**2 / d.stiffness) ** (1 / (d.exponent + 1))


def followed(discs: Discs, duration: float, rtol: np.ndarray) -> tuple[np.ndarray, ...]:
    """Positions and velocities after the duration, and the number of touches."""
    lanes = len(discs.radius)
    shape = (lanes, -1)
    everything = np.concatenate([discs.position.reshape(shape), discs.velocity.reshape(shape)], 1)
    end, touches = np.empty_like(everything), np.zeros(lanes, int)
    who, equations = np.arange(lanes), _Equations(discs)
    none = np.zeros(equations.used.shape)
    s = _State(np.zeros(lanes), everything, none > 0, none > 0, none)
    speed, length = equations.units(s.y)
    h = 1e-3 * length / speed
    # The bracket of an event: steps before and beyond it, with the smallest gaps there.
    low, high = np.zeros(lanes), np.full(lanes, np.nan)
    gap_low, gap_high = np.zeros(lanes), np.zeros(lanes)
    sought = np.zeros((lanes, 4 * none.shape[1]), bool)
    _, _, fast, faster = equations.motion(s.y, s.closed, s.rising, s.latched)
    side = np.zeros(lanes)
    while len(who):
        tick, left = length / speed, duration - s.t
        h = np.where(np.isnan(high), np.minimum(h, left), h)
        y, error = _step(equations, s, h, rtol, speed, length)
        _, depth, rate, second = equations.motion(y, s.closed, s.rising, s.latched)
        gaps, passed = _events(equations, s, depth, rate, second, speed, length)
        seeks = ~np.isnan(high)
        # Time at which a closing speed exceeds its peak within a step, by the cubic through its
        # ends.
        over = s.closed & ~s.rising & (equations.discs.alpha > 0)[:, None] & (second < 0)
        over = over & (_highest(h, fast, faster, rate, second) > s.latched + 1e-13 * speed[:, None])
        hidden = over.any(axis=1) & (h > 1e-5 * tick)
        fine = ((error <= 1) & ~hidden) | seeks
        begins = fine & ~seeks & passed.any(axis=1)
        # The search of a step requires its gaps at the start.
        if begins.any():
            _, *at = equations.motion(s.y, s.closed, s.rising, s.latched)
            start = _events(equations, s, *at, speed, length)[0]
            sought = np.where(begins[:, None], passed, sought)
            gap_low = np.where(begins, np.min(np.where(sought, start, np.inf), axis=1), gap_low)
        least = np.min(np.where(sought, gaps, np.inf), axis=1)
        low = np.where(begins, 0, low)
        # Illinois: halve the gap of the bound that stays.
        below = least < 0
        up = begins | (seeks & below)
        gap_low = np.where(seeks & below & (side == 1), gap_low / 2, gap_low)
        gap_high = np.where(seeks & ~below & (side == -1), gap_high / 2, gap_high)
        side = np.where(begins, 0, np.where(below, 1, -1))
        high, gap_high = np.where(up, h, high), np.where(up, least, gap_high)
        low = np.where(seeks & ~below, h, low)
        gap_low = np.where(seeks & ~below, least, gap_low)
        at_once = begins & (gap_low <= 0)
        narrow = high - low <= 4e-16 * (tick + high)
        found = (seeks & ((np.abs(least) <= 1e-16) | narrow)) | at_once
        with np.errstate(invalid="ignore", divide="ignore"):
            secant = low + (high - low) * gap_low / (gap_low - gap_high)
        inside = (secant > low) & (secant < high)
        trial = np.where(inside, secant, (low + high) / 2)

        taken = (fine & ~seeks & ~begins) | (found & ~at_once)
        s.t = np.where(taken, s.t + h, s.t)
        s.y = np.where(taken[:, None], y, s.y)
        with np.errstate(divide="ignore"):
            factor = np.clip(0.9 * error ** (-1 / 8), 0.2, 6)
        fast, faster = (np.where(taken[:, None], a, b) for a, b in ((rate, fast), (second, faster)))
        h = np.where(seeks | begins, trial, h * np.where(hidden, np.minimum(factor, 0.5), factor))
        if found.any():
            hits = _happen(equations, s, found, sought, speed, length)
            _, _, fast, faster = equations.motion(s.y, s.closed, s.rising, s.latched)
            touches[who] += hits
            new = equations.units(s.y)
            speed, length = (
                np.where(found, a, b) for a, b in zip(new, (speed, length), strict=True)
            )
            h = np.where(found, np.where(hits > 0, 1e-5, 1e-3) * length / speed, h)
            high = np.where(found, np.nan, high)
            sought = sought & ~found[:, None]
        # A step too short for any contact.
        free = ~s.closed.any(axis=1)
        nearest = np.min(np.where(equations.used, np.abs(depth), np.inf), axis=1)
        most = np.where(free, np.maximum(0.1 * length / speed, 0.25 * nearest / speed), 0.1 * tick)
        h = np.where(np.isnan(high), np.minimum(h, most), h)

        over = s.t >= duration * (1 - 1e-15)
        if over.any():
            end[who[over]] = s.y[over]
            on = ~over
            who, rtol, equations = who[on], rtol[on], _Equations(equations.discs.some(on))
            s = _State(*(x[on] for x in vars(s).values()))
            h, low, high, gap_low, gap_high = (x[on] for x in (h, low, high, gap_low, gap_high))
            sought, side, speed, length = (x[on] for x in (sought, side, speed, length))
            fast, faster = fast[on], faster[on]
    n = discs.position.shape[1]
    return end[:, : 2 * n].reshape(lanes, n, 2), end[:, 2 * n :].reshape(lanes, n, 2), touches


def _step(equations, s, h, rtol, speed, length):
    """A step of DOP853, and its error beside what is tolerated."""
    slopes = np.empty((STAGES + 1, *s.y.shape))
    for k in range(STAGES):
        moved = s.y
        if k:
            moved = s.y + h[:, None] * np.tensordot(dop853.A[k, :k], slopes[:k], axes=1)
        slopes[k] = equations.motion(moved, s.closed, s.rising, s.latched)[0]
    y = s.y + h[:, None] * np.tensordot(dop853.B, slopes[:STAGES], axes=1)
    slopes[STAGES] = equations.motion(y, s.closed, s.rising, s.latched)[0]
    half = s.y.shape[1] // 2
    sizes = np.repeat(np.stack([length, speed], axis=1), half, axis=1)
    scale = rtol[:, None] * (sizes + np.maximum(np.abs(s.y), np.abs(y)) * 1e-3)
    fifth = np.tensordot(dop853.E5, slopes, axes=1) / scale
    third = np.tensordot(dop853.E3, slopes, axes=1) / scale
    five, three = np.sum(fifth**2, axis=1), np.sum(third**2, axis=1)
    both = np.sqrt((five + 0.01 * three) * s.y.shape[1])
    return y, h * five / np.where(both > 0, both, 1)


def _highest(h, before, pace, after, slope):
    """The most of the cubic that has these values and slopes at the ends of a step."""
    at = np.linspace(0, 1, 9)[:, None, None]
    rest = at * (1 - at)
    h, rise = h[:, None], after - before
    bend = (1 - at) * (h * pace - rise) + at * (rise - h * slope)
    return np.max(before + at * rise + rest * bend, axis=0)


def _events(equations, s, depth, rate, second, speed, length):
    """What falls through zero, in units of contacts, and what has done so: a pair touches, parts,
    is fastest, or exceeds what it was at its fastest.
    """
    x, v = length[:, None], speed[:, None]
    used, follows = equations.used, (equations.discs.alpha > 0)[:, None]
    gaps = np.concatenate(
        [-depth / x, depth / x, second / (v * v / x), (s.latched - rate) / v], axis=1
    )
    still = s.closed & follows
    may = [
        used & ~s.closed & (rate > 0),
        s.closed & (rate < 0),
        still & s.rising,
        still & ~s.rising & (second > 0),
    ]
    return gaps, (gaps < 0) & np.concatenate(may, axis=1)


def _happen(equations, s, found, sought, speed, length):
    """The events of the lanes that found one; how many touches there are."""
    _, depth, rate, second = equations.motion(s.y, s.closed, s.rising, s.latched)
    gaps, _ = _events(equations, s, depth, rate, second, speed, length)
    gaps = np.where(sought, gaps, np.inf)
    now = found[:, None] & sought & (gaps <= np.maximum(np.min(gaps, axis=1), 0)[:, None] + 1e-14)
    touch, part, latch, rise = np.split(now, 4, axis=1)
    s.closed = (s.closed | touch) & ~part
    s.latched = np.where(touch | latch, np.maximum(rate, 0), s.latched)
    second = equations.motion(s.y, s.closed, s.rising, s.latched)[3]
    follows = (equations.discs.alpha > 0)[:, None]
    s.rising = (s.rising | rise | (touch & (second > 0) & follows)) & ~latch & ~part
    return touch.sum(axis=1)

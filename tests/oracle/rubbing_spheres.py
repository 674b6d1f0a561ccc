"""Spheres with springs and sliders at their contacts, integrated by SciPy from event to event.

Everything is in SI units. An end of a step is a touch, an opening, or a change between stick and
slip of one contact. The forces are F = K δ^1.5 (1 + α δ'/v0), v0 the closing speed at touch, and
the friction of one tangential spring with k = 1.5 κ K δ^0.5, |f| ≤ μF. With a ramp v_d it is
-μF min(|u|/v_d, 1) u/|u| instead.
"""

import dataclasses
import math

import numpy as np
from scipy.integrate import solve_ivp

from tests.oracle.stored import stored

APART, STICKS, SLIPS = range(3)


def turn(spin, arm):
    """ω × r; a spin in the plane is one number."""
    if len(arm) == 2:
        return spin[0] * np.array([-arm[1], arm[0]])
    return cross(spin, arm)


def moment(arm, force):
    if len(arm) == 2:
        return np.array([arm[0] * force[1] - arm[1] * force[0]])
    return cross(arm, force)


def cross(a, b):
    """a × b; `np.cross` takes ten times as long for one pair."""
    (a, b, c), (x, y, z) = a.tolist(), b.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def size(vector):
    return math.sqrt(vector @ vector)


@dataclasses.dataclass
class RubbingSpheres:
    """Spheres of given radius, mass and inertia, with planes (normal, offset, drift) and a fixed
    shell around the origin, if its radius is given.
    """

    radius: np.ndarray
    mass: np.ndarray
    inertia: np.ndarray
    gravity: np.ndarray
    stiffness: float
    alpha: float
    mu: float
    kappa: float
    planes: tuple = ()
    shell: float | None = None
    ramp: float | None = None

    def __post_init__(self):
        count = len(self.radius)
        self.pairs = [(i, j) for i in range(count) for j in range(i)]
        self.pairs += [(i, ("plane", k)) for i in range(count) for k in range(len(self.planes))]
        self.pairs += [(i, ("shell", 0)) for i in range(count) if self.shell is not None]
        self.dim = len(self.gravity)
        self.axes = 1 if self.dim == 2 else 3
        sizes = [count * self.dim, count * self.dim, count * self.axes, len(self.pairs) * self.dim]
        self.cuts = [0, *np.cumsum(sizes).tolist()]

    def split(self, y):
        dim, (a, b, c, d, e) = self.dim, self.cuts
        parts = y[a:b], y[b:c], y[c:d], y[d:e]
        sizes = dim, dim, self.axes, dim
        return tuple(part.reshape(-1, n) for part, n in zip(parts, sizes, strict=True))

    def geometry(self, y, pair):
        """Indentation, normal towards the first body, n', relative velocity, and slip velocity."""
        x, v, w, _ = self.split(y)
        i, other = pair
        r = self.radius[i]
        if not isinstance(other, tuple):
            apart, relative = x[i] - x[other], v[i] - v[other]
            length = size(apart)
            normal, depth = apart / length, r + self.radius[other] - length
            arms = r - depth / 2, self.radius[other] - depth / 2
            turned = turn(arms[0] * w[i] + arms[1] * w[other], normal)
        elif other[0] == "plane":
            normal, offset, drift = self.planes[other[1]]
            normal, relative, length = np.asarray(normal), v[i], np.inf
            depth = r + offset - x[i] @ normal
            relative = v[i] - np.asarray(drift)
            turned = turn((r - depth) * w[i], normal)
        else:
            length = -size(x[i])
            normal, relative = x[i] / length, v[i]
            depth = r - self.shell - length
            turned = turn((r - depth / 2) * w[i], normal)
        across = relative - (relative @ normal) * normal
        return depth, normal, across / length, -(relative @ normal), across - turned

    def force(self, depth, rate, v0):
        return self.stiffness * max(depth, 0) ** 1.5 * max(1 + self.alpha * rate / v0, 0)

    def rates(self, y, modes, v0):
        x, v, w, f = self.split(y)
        push, twist = np.tile(self.gravity, (len(x), 1)).astype(float), np.zeros_like(w)
        found = []
        for k, pair in enumerate(self.pairs):
            depth, normal, bend, rate, slip = self.geometry(y, pair)
            force, friction = 0.0, np.zeros_like(normal)
            if modes[k] != APART:
                force, friction = self.force(depth, rate, v0[k]), f[k]
                if modes[k] == SLIPS:
                    friction = self.mu * force * self.along(f[k], slip)
                if self.ramp is not None:
                    friction = -self.mu * force * slip / max(size(slip), self.ramp)
            found.append((depth, normal, bend, rate, slip, force))
            i, other = pair
            total, arm = force * normal + friction, self.radius[i] - depth / 2
            if isinstance(other, tuple) and other[0] == "plane":
                arm = self.radius[i] - depth
            push[i] += total / self.mass[i]
            twist[i] += moment(-arm * normal, friction) / self.inertia[i]
            if not isinstance(other, tuple):
                push[other] -= total / self.mass[other]
                arm = self.radius[other] - depth / 2
                twist[other] += moment(arm * normal, -friction) / self.inertia[other]
        springs = np.zeros_like(f)
        for k, (pair, (depth, normal, bend, rate, slip, _)) in enumerate(
            zip(self.pairs, found, strict=True)
        ):
            if modes[k] == APART or depth <= 0 or self.ramp is not None:
                continue
            stiff = 1.5 * self.kappa * self.stiffness * depth**0.5
            springs[k] = -stiff * slip
            if modes[k] == SLIPS:
                e = self.along(f[k], slip)
                grows = self.grows(y, pair, push, depth, normal, rate, v0[k])
                springs[k] += (stiff * (e @ slip) + self.mu * grows) * e
            springs[k] -= normal * (bend @ f[k])
        return np.concatenate([v.ravel(), push.ravel(), twist.ravel(), springs.ravel()])

    def grows(self, y, pair, push, depth, normal, rate, v0):
        """dF/dt."""
        i, other = pair
        v = self.split(y)[1]
        second = push[i] - (0 if isinstance(other, tuple) else push[other])
        bend = self.geometry(y, pair)[2]
        relative = v[i] - (0 if isinstance(other, tuple) else v[other])
        curve = -(second @ normal) - relative @ bend
        factor = 1 + self.alpha * rate / v0
        if factor <= 0:
            return 0.0
        slope = 1.5 * depth**0.5 * rate * factor + depth**1.5 * self.alpha * curve / v0
        return self.stiffness * slope

    @staticmethod
    def along(force, slip):
        length = size(force)
        if length > 0:
            return force / length
        pace = size(slip)
        return -slip / pace if pace > 0 else np.zeros_like(slip)

    def run(self, x, v, w, duration, tolerance=1e-12):
        """Positions, velocities and spins at the end, and the number of events."""
        dim = np.shape(x)[1]
        y = np.concatenate(
            [np.ravel(x), np.ravel(v), np.ravel(w), np.zeros(len(self.pairs) * dim)]
        ).astype(float)
        modes, v0 = [APART] * len(self.pairs), [1.0] * len(self.pairs)
        t, events = 0.0, 0
        springs = slice(len(y) - len(self.pairs) * dim, None)
        while t < duration:
            tests = [self._test(k, modes, v0) for k in range(len(self.pairs))]
            tests = [one for several in tests for one in several]
            # Free flight is a polynomial, and no touch is over within 4 mm at these speeds.
            longest = 2e-3 if set(modes) == {APART} else 2e-4
            out = solve_ivp(
                lambda t, y, modes=tuple(modes), v0=tuple(v0): self.rates(y, modes, v0),
                (t, duration), y, method="DOP853", rtol=tolerance, atol=tolerance * 1e-2,
                events=[test for test, _, _ in tests], max_step=longest,
            )  # fmt: skip
            t, y = out.t[-1], out.y[:, -1].copy()
            if out.status != 1:
                break
            events += 1
            hit = next(k for k, times in enumerate(out.t_events) if len(times))
            _, pair, mode = tests[hit]
            rate, slip = self.geometry(y, self.pairs[pair])[3:]
            force = y[springs].reshape(-1, dim)
            if modes[pair] == APART:
                v0[pair], force[pair] = rate, 0
                grip = self.mu * (1 + self.alpha) * rate
                mode = SLIPS if self.kappa * size(slip) > grip else STICKS
            if mode == APART:
                force[pair] = 0
            y[springs] = force.ravel()
            modes[pair] = mode
        x, v, w, _ = self.split(y)
        return x, v, w, events

    def _test(self, k, modes, v0):
        pair, mode, tests = self.pairs[k], modes[k], []

        def opens(t, y):
            return self.geometry(y, pair)[0]

        opens.terminal, opens.direction = True, 1 if mode == APART else -1
        tests.append((opens, k, APART if mode != APART else None))
        if self.ramp is not None:
            return tests
        if mode == STICKS:

            def slips(t, y):
                depth, _, _, rate, _ = self.geometry(y, pair)
                held = size(self.split(y)[3][k])
                return self.mu * self.force(depth, rate, v0[k]) - held + 1e-13

            slips.terminal, slips.direction = True, -1
            tests.append((slips, k, SLIPS))
        if mode == SLIPS:
            modes, v0 = tuple(modes), tuple(v0)

            def sticks(t, y):
                depth, normal, _, rate, slip = self.geometry(y, pair)
                push = self.rates(y, modes, v0)
                count, dim = len(self.radius), len(self.gravity)
                push = push[count * dim : 2 * count * dim].reshape(count, dim)
                force = self.split(y)[3][k]
                e = self.along(force, slip)
                stiff = 1.5 * self.kappa * self.stiffness * max(depth, 0) ** 0.5
                grows = self.grows(y, pair, push, max(depth, 0), normal, rate, v0[k])
                return -stiff * (e @ slip) - self.mu * grows

            sticks.terminal, sticks.direction = True, -1
            tests.append((sticks, k, STICKS))
        return tests


@stored()
def integrated(radius, mass, gravity, start, duration, law, more):
    """Velocities and spins of solid spheres at the end; the law has K, α, μ and κ."""
    found = RubbingSpheres(radius, mass, 0.4 * mass * radius**2, gravity, *law, **more)
    return found.run(*start, duration)[1:3]

"""One impact by collocation in extended precision: the oracle for impacts without a formula.

`x'' = Γ - x^(n-p) (x^p + c x')`, `x(0) = 0`, `x'(0) = 1`. Every law of the registry has this shape:
p = 0 is the Hunt-Crossley family, p = 1 Kuwabara-Kono, p = (n+1)/2 the linear oscillators.

It is solved for w = x^(1/k) and u = v + b x^p over τ with dt = w^(k-1) dτ, where k makes powers
integer. With strong damping b = 1/c. Then u is the force itself, which a creeping contact would
otherwise lose in the difference of its two parts. Radau's method handles the stiffness of the
creep. The Legendre coefficients set the length of steps, and Newton's method places their ends on
the events.
"""

from __future__ import annotations

import numpy as np

from .collocation import (
    EXTENDED,
    STAGES,
    TINY,
    Array,
    absolute_power,
    largest_product,
    radau,
    solve_small,
)
from .kinds import SEPARATED, SETTLED, Problem, Truth

TOLERANCE = 1e-11
"""Of the last Legendre coefficient in a step; a hundred times finer moves results by 1e-15."""
STRONG = 1.0
"""The c from which on the force itself is the variable."""
MOST_STEPS = 1500
LANES_AT_ONCE = 1500

_NEWTON = 14
_LANDINGS = 60
# Samples of the way without a force.
_RETURNS = 64


def solve(problem: Problem, tolerance: float = TOLERANCE) -> Truth:
    """The truth of every lane."""
    found = Truth.empty(len(problem))
    # Lanes of similar damping take similar numbers of steps.
    order = np.argsort(problem.c, kind="stable")
    for start in range(0, len(problem), LANES_AT_ONCE):
        index = order[start : start + LANES_AT_ONCE]
        with np.errstate(all="ignore"):
            found.put(index, _Lanes(problem.at(index), tolerance).run())
    return found


def _orders(problem: Problem) -> Array:
    """The smallest of 2 and 4 that makes all powers of w whole; 8, which is smooth enough, if none.

    With it touch and separation are smooth points.
    """
    found = np.full(len(problem), EXTENDED(8))
    for k in (4, 2):
        whole = (k * problem.n % 1 == 0) & (k * problem.p % 1 == 0)
        found[whole] = k
    return found


def _creeps_in(push: Array, c: Array, p: Array, n: Array, x: Array, v: Array) -> Array:
    """Whether the bodies creep to rest under a push, from below and without ever turning.

    Near rest y'' + d y' + s y = 0; overdamped, y > 0 has no zero where it falls slower than
    e^(-λt), λ the faster of its two rates.
    """
    rest = np.maximum(push, 0) ** (1 / n)
    d, s = c * rest ** (n - p), n * rest ** (n - 1)
    root = d * d - 4 * s
    fast = (d + np.sqrt(np.maximum(root, 0))) / 2
    y = rest - x
    return (
        (root > 0) & (y > 0) & (y <= EXTENDED("1e-5") * rest) & (v <= EXTENDED("0.999") * fast * y)
    )


class _Lanes:
    """The state of a chunk of lanes, and the loop that moves them on."""

    def __init__(self, problem: Problem, tolerance: float):
        count = len(problem)
        self.given = problem
        self.tolerance = EXTENDED(tolerance)
        self.c = problem.c.copy()
        strong = self.c > STRONG
        self.b = np.where(strong, 1 / np.where(strong, self.c, 1), 0)
        self.w = np.zeros(count, EXTENDED)
        # At touch x^p is 0, but 1 for p = 0.
        self.u = 1 + self.b * (problem.p == 0)
        self.t, self.loss, self.xm, self.tc, self.fm = (np.zeros(count, EXTENDED) for _ in range(5))
        self.k = _orders(problem)
        # Order of the largest force: no step has to follow less.
        q = problem.n - problem.p + 1
        deep = np.minimum(1, (q / np.maximum(self.c, q)) ** (1 / q))
        deep = np.minimum(deep, 1 / np.maximum(1, -2 * problem.push))
        self.expected = EXTENDED("0.01") * deep**problem.n
        self.h = EXTENDED("1e-2") / (1 + self.c + np.abs(problem.push)) ** (1 / self.k)
        self.low, self.high = np.zeros(count, EXTENDED), np.zeros(count, EXTENDED)
        self.landing = np.zeros(count, int)
        self.event = np.zeros(count, int)
        self.out = np.zeros(count, bool)
        # A force without a power of x jumps at touch.
        self.fm[:] = np.where(problem.n == problem.p, self.c, 0)
        self.found = Truth.empty(count)

    def run(self) -> Truth:
        active = np.arange(self.w.size)
        for _ in range(MOST_STEPS):
            if active.size == 0:
                break
            self.found.steps[active] += 1
            active = active[~self.advance(active)]
        return self.found

    def advance(self, i: Array) -> Array:
        """One trial step of the lanes i; which of them are finished."""
        q = self.given
        rule = radau()
        n, p, push = q.n[i], q.p[i], q.push[i]
        c, b, w0, u0, h = self.c[i], self.b[i], self.w[i], self.u[i], self.h[i]
        strong = b > 0
        lanes = i.size
        inverse, square = rule.inverse[:, :, None], rule.square[:, :, None]
        k = self.k[i]
        a1 = k * (n - p) + k - 1

        def parts(w: Array, u: Array) -> tuple[Array, ...]:
            """v, the force over x^(n-p), x^(n-p) dt/dτ, w^(kp-1), du/dτ, x^p and dt/dτ."""
            logarithm = np.log(np.maximum(np.abs(w), TINY))
            wp = np.where(p == 0, 1, np.exp(k * p * logarithm))
            inner = np.where(p == 0, 0, np.exp((k * p - 1) * logarithm))
            clock = np.where(k == 2, w, np.exp((k - 1) * logarithm))
            outer = np.exp(a1 * logarithm)
            v = u - b * wp
            force = np.where(strong, c * u, wp + c * u)
            slope = push * clock - outer * force + b * p * inner * v
            return v, force, outer, inner, slope, wp, clock

        v0, *_, wp0, _ = parts(w0, u0)
        # A contact that does not end where the force vanishes needs v, not the force.
        floor = np.where(q.tension[i] | (p == 0) & (push >= 0), b * wp0, 0)
        floor = np.maximum(floor, np.abs(u0))
        z = rule.nodes[:, None] * (h * v0 / k)
        d = np.zeros((STAGES, lanes), EXTENDED)
        good = np.zeros(lanes, bool)
        todo = np.ones(lanes, bool)
        scale_w = scale_u = None
        for _ in range(_NEWTON):
            w, u = w0 + z, u0 + d
            v, force, outer, inner, slope, _, clock = parts(w, u)
            safe = np.where(np.abs(w) > 0, w, TINY)
            outer_w = a1 * outer / safe
            force_w = np.where(strong, 0, k * p * inner)
            slope_w = push * (k - 1) * clock / safe - outer_w * force - outer * force_w
            slope_w += b * p * ((k * p - 1) * inner / safe * v - k * p * b * inner * inner)
            slope_u = -outer * c + b * p * inner
            m = k * b * p * inner
            e1 = h * (k * np.einsum("ij,jl->il", rule.inverse, z) / h - v)
            e2 = h * (np.einsum("ij,jl->il", rule.inverse, d) / h - slope)
            matrix = k * square + inverse * (h * m)[None] - inverse * (k * h * slope_u)[:, None]
            diagonal = np.arange(STAGES)
            matrix[diagonal, diagonal] -= h * h * (slope_u * m + slope_w)
            right = -h * e2 - np.einsum("ij,jl->il", rule.inverse, e1) + h * slope_u * e1
            dz = solve_small(matrix, right)
            dd = (k * np.einsum("ij,jl->il", rule.inverse, dz) + h * m * dz + e1) / h
            z = np.where(todo, z + dz, z)
            d = np.where(todo, d + dd, d)
            scale_w = np.maximum(np.abs(w0), np.max(np.abs(z), 0))
            scale_u = np.maximum(floor, np.max(np.abs(d), 0))
            tiny_step = np.max(np.abs(dz), 0) / scale_w + np.max(np.abs(dd), 0) / scale_u
            good = np.where(todo, tiny_step < 1e-9, good)
            todo = todo & ~good & np.isfinite(tiny_step)
            if not todo.any():
                break
        w, u = w0 + z, u0 + d
        v, force, outer, inner, slope, _, clock = parts(w, u)
        error_w = np.abs(np.einsum("j,jl->l", rule.spectrum, z)) / scale_w
        error_u = np.abs(np.einsum("j,jl->l", rule.spectrum, d)) / scale_u
        error = np.maximum(error_w, error_u)
        # The force has a hundredth of the weight, since its maximum is interpolated between the
        # nodes.
        jolt = outer / np.where(clock != 0, np.abs(clock), 1) * force - self._force_at(i)
        biggest = np.maximum(np.maximum(self.fm[i], np.max(np.abs(jolt), 0)), self.expected[i])
        error_f = np.abs(np.einsum("j,jl->l", rule.spectrum, jolt)) / biggest / 100
        error = np.maximum(error, np.where(self._rises_smoothly(i), error_f, 0))
        good &= np.isfinite(error)
        fine = good & (error <= self.tolerance)
        landing = self.landing[i] > 0
        ratio = np.where(good, (self.tolerance / np.maximum(error, EXTENDED("1e-30"))), 0)
        grow = np.clip(0.9 * ratio ** (EXTENDED(1) / STAGES), 0.2, 4)
        # An inaccurate trial is repeated, and its landing discarded.
        bad = ~fine
        self.h[i] = np.where(bad, h * np.where(good, np.minimum(grow, 0.9), 0.25), h)
        self.landing[i] = np.where(bad, 0, self.landing[i])
        landing &= fine

        # --- events
        out = self.out[i]
        clamped = ~q.tension[i]
        # If the two parts of a force cancel, they do so before x = 0.
        gap_part = np.where(out & ~(clamped & (p > 0) & (c > 0)), w, 1)
        # A free contact of the family never pulls, although its force may underflow.
        pulls = clamped & ~((p == 0) & (push >= 0))
        beyond = np.where((w < 0) & (p > 0), c * v, force)
        gap_clamp = np.where(out & pulls, beyond, 1)
        gap_turn = np.where(out, 1, v)
        gaps = np.stack([gap_turn, gap_part, gap_clamp])  # (3, s, lanes)
        met = (gaps <= 0).any(0)
        first = np.where(met.any(0), np.argmax(met, 0), -1)
        meets = fine & ~landing & (first >= 0)
        if meets.any():
            at = np.flatnonzero(meets)
            j = first[at]
            which = np.argmax(gaps[:, j, at] <= 0, axis=0)
            after = gaps[which, j, at]
            before = np.where(j > 0, gaps[which, np.maximum(j - 1, 0), at], EXTENDED(1))
            left = np.where(j > 0, rule.nodes[np.maximum(j - 1, 0)], 0)
            share = np.where(j > 0, before / (before - after), EXTENDED("0.5"))
            fraction = left + np.clip(share, 0.02, 0.98) * (rule.nodes[j] - left)
            self.event[i[at]] = which
            self.landing[i[at]] = 1
            self.low[i[at]], self.high[i[at]] = 0, h[at] * rule.nodes[j]
            self.h[i[at]] = h[at] * fraction
        arrived = np.zeros(lanes, bool)
        if landing.any():
            at = np.flatnonzero(landing)
            which = self.event[i[at]]
            we, ve, fe, oe, ie, se, ke = (
                a[-1, at] for a in (w, v, force, outer, inner, slope, clock)
            )
            acceleration = push[at] * ke - oe * fe
            rate_force = np.where(strong[at], c[at] * se, p[at] * ie * ve + c[at] * se)
            fe = np.where((we < 0) & (p[at] > 0), c[at] * ve, fe)
            # Weak damping ends so close to x = 0 that x^p is flat there, but x is not.
            flat = (which == 2) & ~strong[at] & (p[at] > 0)
            root = np.where(flat, absolute_power(c[at] * np.minimum(ve, 0), 1 / (k[at] * p[at])), 0)
            fe = np.where(flat, we - root, fe)
            rate_flat = ve / k[at] - root / (k[at] * p[at]) * acceleration / ve
            rate_force = np.where(flat, rate_flat, rate_force)
            gap = np.choose(which, [ve, we, fe])
            rate = np.choose(which, [acceleration, ve / k[at], rate_force])
            low = np.where(gap > 0, h[at], self.low[i[at]])
            high = np.where(gap > 0, self.high[i[at]], h[at])
            change = -gap / rate
            target = h[at] + change
            outside = ~((target > low) & (target < high))
            close = np.abs(change) <= EXTENDED("4e-19") * h[at]
            count = self.landing[i[at]]
            arrived[at] = close | (count >= _LANDINGS) | (high - low <= EXTENDED("2e-19") * high)
            # Mostly Newton; every fourth step is a bisection, which corners require.
            target = np.where(outside | (count % 8 == 7), (low + high) / 2, target)
            # If another event came first, land on that one.
            sooner = arrived[at] & (pulls[at] & (p[at] == 0))
            other = np.where(which == 1, fe, we)
            sooner &= (which > 0) & (other < -EXTENDED("1e-17"))
            arrived[at] &= ~sooner
            self.event[i[at]] = np.where(sooner, 3 - which, which)
            self.low[i[at]] = np.where(sooner, 0, low)
            self.high[i[at]] = np.where(sooner, h[at], high)
            self.landing[i[at]] = np.where(arrived[at], 0, np.where(sooner, 1, count + 1))
            target = np.where(sooner, h[at] / 2, target)
            self.h[i[at]] = np.where(arrived[at], self.h[i[at]], target)
        accept = (fine & ~landing & ~meets) | arrived
        at = np.flatnonzero(accept)
        done = np.zeros(lanes, bool)
        if at.size:
            done[at] = self._accept(
                i[at],
                h[at],
                w[:, at],
                u[:, at],
                v[:, at],
                force[:, at],
                outer[:, at],
                clock[:, at],
                z[:, at],
                d[:, at],
                arrived[at],
                grow[at],
            )
        return done

    def _accept(self, i, h, w, u, v, force, outer, clock, z, d, arrived, grow) -> Array:
        rule, q = radau(), self.given
        n, p, push = q.n[i], q.p[i], q.push[i]
        c, b, k = self.c[i], self.b[i], self.k[i]
        weights = rule.matrix[-1]
        self.t[i] += h * np.einsum("j,jl->l", weights, clock)
        self.loss[i] += h * np.einsum("j,jl->l", weights, c * outer * v * v)
        # The force F = x^(n-p) (x^p + c v).
        f = outer / np.where(clock != 0, np.abs(clock), 1) * force
        self._largest_force(i, w, force, f)
        we, ue, ve = self.w[i] + z[-1], self.u[i] + d[-1], v[-1]
        event = np.where(arrived, self.event[i], -1)
        turned, parted = event == 0, event >= 1
        self.h[i] = np.where(arrived, h, h * grow)
        # At the turn: v = 0, and damping on approach only is switched off.
        self.tc[i] = np.where(turned, self.t[i], self.tc[i])
        x = absolute_power(we, k)
        self.xm[i] = np.where(turned, x, np.maximum(self.xm[i], x))
        ends = turned & q.approach[i]
        self.c[i] = np.where(ends, 0, c)
        self.b[i] = np.where(ends, 0, b)
        wp = absolute_power(we, k * p)
        self.u[i] = np.where(turned, self.b[i] * wp, ue)
        self.w[i] = np.where(event == 1, 0, we)
        was_out = self.out[i]
        self.out[i] |= turned
        stored = absolute_power(we, k * (n + 1)) / (n + 1)
        energy = ve * ve / 2 + stored - push * x
        back = was_out & (ve > 0) & ~parted
        held = (push > 0) & (energy < 0)
        creeps = ~was_out & ~turned & held & _creeps_in(push, c, p, n, x, ve)
        # From critical damping on, a damped oscillator that may pull has no end.
        forever = turned & (push == 0) & q.tension[i] & (2 * p == n + 1) & ~q.approach[i]
        forever &= c >= 2 * np.sqrt(p)
        # If the force vanishes at x > 0 with too little energy to reach x = 0, the push holds the
        # bodies.
        parted &= ~(held & (event == 2))
        parted[self._goes_on(i, parted & (event == 2) & (push > 0), x, ve)] = False
        settled = (was_out & ~parted & (held | back)) | creeps | forever
        done = parted | settled
        at = np.flatnonzero(done)
        if at.size:
            clamped = event[at] == 2
            self._finish(i[at], parted[at], creeps[at], clamped, x[at], ve[at], stored[at])
        return done

    def _goes_on(self, i: Array, clamped: Array, x: Array, v: Array) -> Array:
        """Lanes whose force returns before x = 0 belong to the same contact: they start from there.

        Without a force the bodies move by x'' = Γ. The first moment with x^p + c v > 0 is found
        between samples, which are denser near x = 0.
        """
        at = np.flatnonzero(clamped)
        index = i[at]
        x, v, c = x[at], v[at], self.c[index]
        push, p, k = self.given.push[index], self.given.p[index], self.k[index]
        landing = 2 * x / (-v + np.sqrt(np.maximum(v * v - 2 * push * x, 0)))

        def moved(time: Array) -> tuple[Array, Array]:
            return x + (v + push * time / 2) * time, v + push * time

        def acts(time: Array) -> Array:
            place, speed = moved(time)
            return absolute_power(np.maximum(place, TINY), p) + c * speed > 0

        fractions = 1 - (1 - np.arange(1, _RETURNS, dtype=EXTENDED) / _RETURNS) ** 4
        acting = np.array([acts(fraction * landing) for fraction in fractions])
        first = np.argmax(acting, 0)
        low = np.where(first > 0, fractions[np.maximum(first - 1, 0)], 0) * landing
        high = fractions[first] * landing
        for _ in range(_LANDINGS):
            middle = (low + high) / 2
            past = acts(middle)
            low, high = np.where(past, low, middle), np.where(past, middle, high)
        on = acting.any(0)
        at, index = at[on], index[on]
        place, speed = (one[on] for one in moved(high))
        self.t[index] += high[on]
        self.w[index] = absolute_power(place, 1 / k[on])
        self.u[index] = speed + self.b[index] * absolute_power(place, p[on])
        return at

    def _largest_force(self, i: Array, w: Array, force: Array, f: Array) -> None:
        """The largest force within the step, F = w^m g with polynomials w and g of the place.

        Mostly m is 0 and g is F. Where F may rise like a small power, m = k (n - p) and
        g = x^p + c v.
        """
        near = np.flatnonzero(np.max(f, 0) > 0.5 * self.fm[i])
        if near.size == 0:
            return
        q, lanes = self.given, i[near]
        smooth = self._rises_smoothly(lanes)
        m = np.where(smooth, 0, self.k[lanes] * (q.n[lanes] - q.p[lanes]))
        g = np.where(smooth, f[:, near], force[:, near])
        before = np.where(smooth, self._force_at(lanes), self._inner_force_at(lanes))
        nodes = [
            np.concatenate([start[None], step])
            for start, step in ((self.w[lanes], w[:, near]), (before, g))
        ]
        largest = np.maximum(np.max(f[:, near], 0), largest_product(m, *nodes))
        self.fm[lanes] = np.maximum(self.fm[lanes], largest)

    def _rises_smoothly(self, i: Array) -> Array:
        """Whether the force is nearly a polynomial of w, at touch and near it."""
        n, p = self.given.n[i], self.given.p[i]
        return (self.k[i] * (n - p) >= 1) | (n == p)

    def _inner_force_at(self, i: Array) -> Array:
        """x^p + c v at the state before the step."""
        w, u, b, c = self.w[i], self.u[i], self.b[i], self.c[i]
        return np.where(b > 0, c * u, absolute_power(w, self.k[i] * self.given.p[i]) + c * u)

    def _force_at(self, i: Array) -> Array:
        """F at the state before the step."""
        q = self.given
        return absolute_power(self.w[i], self.k[i] * (q.n[i] - q.p[i])) * self._inner_force_at(i)

    def _finish(self, i, parted, creeps, clamped, x, v, stored) -> None:
        found, push = self.found, self.given.push[i]
        lost = 2 * (self.loss[i] + np.where(clamped, stored, 0))
        gained = 2 * push * np.where(clamped, x, 0)
        square = 1 - lost + gained
        largest = 1 + np.abs(2 * push * self.xm[i])
        # e from the speed has the rounding of the largest speed, e from the energies that of the
        # change. The more accurate one counts.
        by_energy = (square > 0) & ((lost + np.abs(gained)) < 2 * np.abs(v) * np.sqrt(largest))
        e = np.where(by_energy, np.sqrt(np.where(square > 0, square, 0)), -v)
        found.status[i] = np.where(parted, SEPARATED, SETTLED)
        found.e[i] = np.where(parted, e, 0)
        found.duration[i] = np.where(parted, self.t[i], np.inf)
        found.compression_time[i] = np.where(creeps, np.inf, self.tc[i])
        found.max_indentation[i] = np.where(
            creeps, np.maximum(push, 0) ** (1 / self.given.n[i]), self.xm[i]
        )
        found.max_force[i] = np.where(creeps, np.maximum(self.fm[i], push), self.fm[i])
        found.loss[i] = np.where(parted, lost, 1)
        found.largest[i] = largest

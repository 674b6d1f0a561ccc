"""ψ2(ψ1; χ) of Maw, Barber and Fawcett without damping, for 0.8 ≤ χ ≤ 1.8, to about 1e-10.

No springs are counted, since all conditions are global without damping. A spring that sticks since
touch has t = U - U(s) with U = ∫ ψ dt and the moment s of its touch. It reaches the limit backward
where x + U is what it was at s, and forward where x - U is. Both grow with s, so slip begins at the
edge and a front moves inwards through the springs in the order of touch, backwards. Springs that
slid from touch have t = P + U - q², with P = x where sliding ended and U counted from there; this
`core` slips backward beyond q² = (P + U + x)/2.

The phases are: all slide (by formula), none slips, a front backward, for χ > 3/2 and small ψ1 a
front forward, the core backward, and all slip. Each is integrated by RK4 over τ, dt = w dτ with
x = w², where it is analytic, and ends where an event is found by bisection.
"""

from __future__ import annotations

import math

import numba
import numpy as np

STEP = 0.0025  # of τ. Steps of 0.001 change no ψ2 by more than 2e-10.
LEAST = 0.02
"""Least part of a step near the end of the core, where w is like the root of the time left."""

ENDED = -1e-15  # margin at which a phase ends; they are 0 where one begins, but for rounding

STICK, BACK, FORTH, CORE, ALL_BACK, ALL_FORTH = range(6)

TAU, W, DW, U, DU, J, DJ, PLUS, DPLUS, MINUS, DMINUS = range(11)
"""Rows of the memory: τ; w, U, J = ∫ U dq over springs that touched while none slipped, x - U and
x + U, each with its derivative."""


@numba.njit
def hermite(memory, row: int, i: int, part: float):
    """Return the value of a row a part of the way from moment i to the next, and its derivative."""
    h = memory[TAU, i + 1] - memory[TAU, i]
    a, b = memory[row, i], memory[row, i + 1]
    da, db = h * memory[row + 1, i], h * memory[row + 1, i + 1]
    two, three = 3 * (b - a) - 2 * da - db, 2 * (a - b) + da + db
    value = a + part * (da + part * (two + part * three))
    return value, da + part * (2 * two + 3 * part * three)


@numba.njit
def moment(memory, count: int, row: int, target: float):
    """Return where a growing row of the memory has a value, as an index and a part."""
    i, high = 0, count - 1
    while high - i > 1:
        middle = (i + high) // 2
        if memory[row, middle] <= target:
            i = middle
        else:
            high = middle
    low, up = 0.0, 1.0
    for _ in range(52):
        part = (low + up) / 2
        if hermite(memory, row, i, part)[0] > target:
            up = part
        else:
            low = part
    return i, low


@numba.njit
def core_edge(state, core: float):
    """Return the q beyond which the core slips backward."""
    return math.sqrt(max((core + state[3] + state[0] ** 2) / 2, 0.0))


@numba.njit
def traction(phase: int, state, core: float, memory, count: int):
    """Return ∫ t dq over the springs in contact."""
    w, moved = state[0], state[3]
    within = math.sqrt(core)
    if phase == ALL_FORTH:
        return 2 * w**3 / 3
    if phase == ALL_BACK:
        return -2 * w**3 / 3
    if phase == CORE:
        edge = core_edge(state, core)
        inner = (core + moved) * edge - edge**3 / 3
        return inner - w * w * (w - edge) + (w**3 - edge**3) / 3
    inner = (core + moved) * within - within**3 / 3
    if phase == STICK:
        return inner + moved * (w - within) - state[4]
    sign = 1.0 if phase == FORTH else -1.0
    i, part = moment(memory, count, PLUS if phase == FORTH else MINUS, w * w - sign * moved)
    front, stored = hermite(memory, W, i, part)[0], hermite(memory, J, i, part)[0]
    slipping = w * w * (w - front) - (w**3 - front**3) / 3
    return inner + moved * (front - within) - stored + sign * slipping


@numba.njit
def rates(phase: int, state, core: float, chi: float, memory, count: int, out):
    """Write the derivatives of w, v, ψ, U and J by τ."""
    w, v, psi, moved, _ = state
    out[0], out[1] = v / 2, -(w**4)
    out[2] = -3 * chi * w * traction(phase, state, core, memory, count)
    out[3], out[4] = w * psi, moved * v / 2


@numba.njit
def stepped(phase: int, state, h: float, core: float, chi: float, memory, count: int, work):
    """Return the state after a step of RK4."""
    for k in range(4):
        at = state + (0.0 if k == 0 else h / 2 if k < 3 else h) * work[max(k - 1, 0)]
        rates(phase, at, core, chi, memory, count, work[k])
    return state + h / 6 * (work[0] + 2 * work[1] + 2 * work[2] + work[3])


@numba.njit
def margins(phase: int, state, core: float, memory, count: int):
    """Return what must be positive for the phase to go on, and for slip not to change its sign."""
    w, v, psi, moved = state[0], state[1], state[2], state[3]
    if phase == STICK:
        return v + psi, 1.0
    # A step may pass the end of the impact, and x is positive again.
    left = w if v < 0 else 1.0
    if phase == CORE:
        return min(core + moved + w * w, left), 1.0
    if phase >= ALL_BACK:
        return left, 1.0
    sign = 1.0 if phase == FORTH else -1.0
    inward = min(w * w - sign * moved - memory[PLUS if phase == FORTH else MINUS, 0], left)
    # At the turn itself the last difference is nothing but rounding.
    if v > 0 or w >= memory[W, count - 1] - 1e-7:
        return inward, 1.0
    i, part = moment(memory, count, W, w)
    return inward, sign * (moved - hermite(memory, U, i, part)[0])


@numba.njit
def advanced(phase: int, state, h: float, core: float, chi: float, memory, count: int, work):
    """Return a step, at most h, that ends where the phase does, the state then and its margins."""
    new = stepped(phase, state, h, core, chi, memory, count, work)
    goes_on, same = margins(phase, new, core, memory, count)
    low, high = 0.0, h
    while min(goes_on, same) < ENDED and high - low > 1e-15:
        middle = (low + high) / 2
        between = stepped(phase, state, middle, core, chi, memory, count, work)
        now = margins(phase, between, core, memory, count)
        if min(now) < ENDED:
            high, new = middle, between
            goes_on, same = now
        else:
            low = middle
    return high, new, goes_on, same


@numba.njit
def remember(memory, count: int, tau: float, state):
    w, v, psi, moved, stored = state
    memory[TAU, count] = tau
    memory[W, count], memory[DW, count] = w, v / 2
    memory[U, count], memory[DU, count] = moved, w * psi
    memory[J, count], memory[DJ, count] = stored, moved * v / 2
    memory[PLUS, count], memory[DPLUS, count] = w * w - moved, w * (v - psi)
    memory[MINUS, count], memory[DMINUS, count] = w * w + moved, w * (v + psi)


@numba.njit
def after_sliding(psi1: float, chi: float, state):
    """Set the state where not all springs slide, and return P of the core and the phase.

    The whole core slips backward at once if sliding ends during restitution.
    """
    state[:] = 0
    state[1], state[2] = 1.0, psi1
    if psi1 <= 1:
        return 0.0, STICK
    v = (2 * chi - psi1) / (2 * chi - 1)
    state[0], state[1], state[2] = (1.25 * (1 - v * v)) ** 0.2, v, v
    return state[0] ** 2, STICK if v > 0 else CORE


@numba.njit
def next_phase(phase: int, turned: bool, core: float):
    if turned:
        return FORTH if phase == BACK else BACK
    if phase == STICK:
        return BACK
    if phase == BACK and core > 0:
        return CORE
    return ALL_FORTH if phase == FORTH else ALL_BACK


@numba.njit
def impact(psi1: float, chi: float, size: float):
    """Return ψ2, and whether some springs slip forward at the end."""
    if psi1 >= 4 * chi - 1:
        return psi1 - 4 * chi, True
    state, work = np.zeros(5), np.zeros((4, 5))
    memory, count, tau = np.zeros((11, int(8 / size))), 0, 0.0
    core, phase = after_sliding(psi1, chi, state)
    while True:
        if phase == STICK:
            remember(memory, count, tau, state)
            count += 1
        h = size * max(core_edge(state, core), LEAST) if phase == CORE else size
        h, state, goes_on, same = advanced(phase, state, h, core, chi, memory, count, work)
        tau += h
        if min(goes_on, same) >= ENDED:
            continue
        if phase >= ALL_BACK:
            return state[2], phase == ALL_FORTH
        if phase == STICK:
            remember(memory, count, tau, state)
            count += 1
        phase = next_phase(phase, same < goes_on, core)


@numba.njit
def rebounds(psi1, chi: float, size: float = STEP):
    """Return ψ2 for an array of ψ1."""
    result = np.empty_like(psi1)
    for k in range(len(psi1)):
        result[k] = impact(psi1[k], chi, size)[0]
    return result


def forward_ends(chi: float) -> float:
    """Return the ψ1 < 1 below which springs slip forward at the end, for 3/2 < χ < 1.8.

    It is 0 at χ = 3/2. ψ2 is smooth on either side of it.
    """
    low, high = 0.0, 1.0
    while high - low > 1e-10:
        middle = (low + high) / 2
        if impact(middle, chi, STEP)[1]:
            low = middle
        else:
            high = middle
    return low

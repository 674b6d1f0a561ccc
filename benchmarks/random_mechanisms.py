"""Random mechanisms with every kind of law: `python -m benchmarks random_mechanisms --each 200`.

Each has two coordinates, a mass matrix that depends on them, springs, dampers, a drive, a push that
begins at a breakpoint, and two gaps, one with a moving wall. A quarter starts moving, at rest
without forces, pressed, and at a touch. All numbers are data, so that one program for a law solves
all of them. The table lists, for each law, the contacts, the imbalance of energy, and the largest
deviation of the derivative of each column of `contacts` along a random direction from Richardson's
differences. For laws without memory touches are compared with SciPy's, restarted at each event.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

import jaxcontact as jc
from benchmarks.study import Study, lines
from benchmarks.until_event import ending

KINDS = "moving", "at rest", "pressed", "touching"
COLUMNS = (
    "time", "closing_speed", "restitution", "duration", "max_force", "max_depth", "energy_loss",
)  # fmt: skip
STEP = 3e-4
"""The relative step of all numbers."""
BENDS = 1e-2
"""Slopes that bend by more than this over two steps have no reference."""


HEADING = """# Random mechanisms

By `python -m benchmarks random_mechanisms --each {EACH}`, at rtol 1e-10. The columns from
`time` on are the largest deviations of derivatives from differences, relative to derivative and
value; those of largest force and depth show the interpolation between steps. Contacts are left out
from the first one on whose gap or slope changes within the differences. Runs end after eight.
"""


MOST = 8
"""The contacts of a run, which ends early with one more."""


class Numbers(NamedTuple):
    """The numbers of mechanisms in SI units; `unit` is a length, `touching` is 1 or 0."""

    unit: Any
    inertia: Any
    springs: Any
    damping: Any
    drive: Any
    rate: Any
    phase: Any
    push: Any
    begins: Any
    clearance: Any
    curve: Any
    tilt: Any
    shake: Any
    shaking: Any
    stiffness: Any
    law: Any
    position: Any
    velocity: Any
    duration: Any
    touching: Any


def mass(t, q, x):
    coupling = x.inertia[1] * jnp.cos((q[0] - q[1]) / x.unit)
    return jnp.stack([x.inertia[0], coupling, coupling, x.inertia[2]]).reshape(2, 2)


def force(t, q, v, x):
    swirl = x.inertia[1] * jnp.sin((q[0] - q[1]) / x.unit) / x.unit
    springs = x.springs[:2] * q + x.springs[2] * (q[0] - q[1]) * jnp.array([1.0, -1.0])
    swirls = swirl * v[::-1] ** 2 * jnp.array([1.0, -1.0])
    driven = x.drive * jnp.sin(x.rate * t + x.phase) + jnp.where(t < x.begins, 0, x.push)
    return driven - springs - x.damping * v - swirls


def gap(t, q, x):
    def places(q):
        return jnp.stack([q[0] + x.curve * q[1] ** 2, -q[1] - x.tilt * q[0]])

    at_touch = jnp.stack([places(x.position)[0], x.clearance[1]])
    clearance = jnp.where(x.touching > 0, at_touch, x.clearance)
    wall = jnp.stack([x.shake * (1 - jnp.cos(x.shaking * t)), jnp.zeros_like(t)])
    return clearance - wall - places(q)


class Kind(NamedTuple):
    """A kind of law: from its numbers, its exponent, and their ranges in scaled units."""

    law: Callable[[Any], Any]
    exponent: float
    ranges: tuple[tuple[float, float], ...] = ()
    units: str = ""


LAWS = {
    "Hertz": Kind(lambda p: jc.Hertz(), 1.5),
    "HuGuo": Kind(lambda p: jc.HuGuo(p[0]), 1.5, ((0.3, 0.95),), "1"),
    "HuGuo, n = 1": Kind(lambda p: jc.HuGuo(p[0]), 1.0, ((0.3, 0.95),), "1"),
    "ConstantDamping": Kind(lambda p: jc.ConstantDamping(p[0]), 1.5, ((0.02, 0.5),), "d"),
    "Bridges": Kind(
        lambda p: jc.Bridges(p[0], jnp.array(0.2), p[1]), 1.5, ((0.5, 0.9), (1.0, 1.1)), "1v"
    ),
    "LinearDashpot": Kind(lambda p: jc.LinearDashpot(p[0]), 1.0, ((0.05, 0.8),), "c"),
    "LinearDashpot, n = 1.5": Kind(lambda p: jc.LinearDashpot(p[0]), 1.5, ((0.05, 0.8),), "c"),
    "KelvinVoigt": Kind(lambda p: jc.KelvinVoigt(p[0]), 1.0, ((0.3, 0.95),), "1"),
    "KelvinVoigt, no tension": Kind(
        lambda p: jc.KelvinVoigt(p[0], tension=False), 1.0, ((0.3, 0.95),), "1"
    ),
    "Tsuji": Kind(lambda p: jc.Tsuji(p[0]), 1.5, ((0.3, 0.95),), "1"),
    "Thornton": Kind(lambda p: jc.Thornton(p[0]), 1.5, ((0.3, 0.9),), "1"),
    "Jankowski": Kind(lambda p: jc.Jankowski(p[0]), 1.5, ((0.3, 0.95),), "1"),
    "StepDamping": Kind(lambda p: jc.StepDamping(p[0], p[1]), 1.5, ((0.1, 1), (0.05, 0.5)), "cx"),
    "KuwabaraKono": Kind(lambda p: jc.KuwabaraKono(p[0]), 1.5, ((0.02, 0.2),), "t"),
    "WaltonBraun": Kind(lambda p: jc.WaltonBraun(p[0], p[1]), 1.0, ((1.1, 4), (0.0, 0.3)), "1s"),
    "ThorntonPlastic": Kind(lambda p: jc.ThorntonPlastic(p[0]), 1.5, ((0.05, 0.6),), "v"),
    "Viscoplastic": Kind(
        lambda p: jc.Viscoplastic(p[0], p[1]), 1.5, ((0.05, 0.6), (0.02, 0.5)), "vd"
    ),
    "Luding": Kind(
        lambda p: jc.Luding(p[0], jnp.array(0.0), p[1]), 1.0, ((1.1, 3), (0.0, 0.5)), "11"
    ),
    "DMT": Kind(lambda p: jc.DMT(p[0]), 1.5, ((0.01, 0.1),), "f"),
    "JKR": Kind(lambda p: jc.JKR(p[0]), 1.5, ((0.01, 0.1),), "f"),
}


def drawn(random: np.random.Generator, name: str, count: int, spread: float = 1.0) -> Numbers:
    """Draw mechanisms, whose units of mass, length and time differ by 10^±`spread`."""
    kind = LAWS[name]

    def between(low: float, high: float, *shape: int) -> np.ndarray:
        return random.uniform(low, high, (count, *shape))

    start = np.arange(count) % 4
    rests, presses, touches = (start == k for k in (1, 2, 3))
    m, x, t = (10 ** between(-spread, spread) for _ in range(3))
    n, first, second = kind.exponent, between(0.5, 2), between(0.3, 2)
    stiffness = 10 ** between(2, 6, 2)
    soft = stiffness.min(axis=1)
    velocity = between(-1, 1, 2)
    velocity[:, 0] = np.where(presses | touches, np.abs(velocity[:, 0]) + 0.3, velocity[:, 0])
    # A gap closes by both coordinates.
    velocity[:, 1] = np.where(presses | touches, 0, velocity[:, 1])
    position = between(-0.2, 0.2, 2)
    velocity[rests], position[rests] = 0, 0
    clearance, curve = between(0.25, 0.6, 2), between(-0.5, 0.5)
    depth = 0.3 * (first * velocity[:, 0] ** 2 / stiffness[:, 0]) ** (1 / (n + 1))
    place = position[:, 0] + curve * position[:, 1] ** 2
    clearance[:, 0] = np.where(presses, place - depth, clearance[:, 0])
    # Those at rest have a drive, a push, a moving wall, or all of them.
    cause = np.where(rests, np.arange(count) // 4 % 4, 3)
    drive = between(-3, 3, 2) * ((cause == 0) | (cause == 3))[:, None]
    push = between(1, 4, 2) * np.where(between(0, 1, 2) < 0.5, -1, 1)
    push[:, 0] = np.where(cause == 1, np.abs(push[:, 0]), push[:, 0])
    push *= ((cause == 1) | (cause == 3))[:, None]
    shake = np.where(cause == 2, between(0.4, 0.8), between(0, 0.1) * (cause == 3))
    lasts = between(2, 4)
    # Units of speed, depth, force and time of a contact.
    deep = soft ** (-1 / (n + 1))
    units = {"1": 1, "v": x / t, "x": x * deep, "c": np.sqrt(soft) * m / t, "t": t * deep}
    units |= {"d": soft * m * x ** (-n) / t, "f": m * x / t**2 * soft * deep**n}
    units["s"] = 1 / (x * deep)
    law = [between(*r) * units[u] for r, u in zip(kind.ranges, kind.units, strict=True)]
    return Numbers(
        unit=x,
        inertia=np.stack([first, between(-0.6, 0.6) * np.sqrt(first * second), second], 1)
        * m[:, None],
        springs=10 ** between(-1, 1, 3) * (m / t**2)[:, None],
        damping=between(0, 0.2, 2) * (m / t)[:, None],
        drive=drive * (m * x / t**2)[:, None],
        rate=between(1, 8) / t,
        phase=np.where(rests, 0, between(0, 6)),
        push=push * (m * x / t**2)[:, None],
        begins=lasts * between(0.2, 0.7) * t,
        clearance=clearance * x[:, None],
        curve=curve / x,
        tilt=between(-0.5, 0.5),
        shake=shake * x,
        shaking=between(2, 6) / t,
        stiffness=stiffness * (m / t**2 * x ** (1 - n))[:, None],
        law=np.stack(law, 1) if law else np.zeros((count, 0)),
        position=position * x[:, None],
        velocity=velocity * (x / t)[:, None],
        duration=lasts * t,
        touching=np.where(touches, 1.0, 0.0),
    )


def simulated(name: str, x: Numbers, **how: Any) -> jc.SystemRun:
    """Simulate one mechanism."""
    kind = LAWS[name]
    system = jc.System(
        mass, force, gap, law=kind.law(x.law), stiffness=x.stiffness, exponent=kind.exponent
    )
    how = {"rtol": 1e-10, "max_impacts": MOST, "throw": False} | how
    # A derivative takes time by the count of numbers that vary.
    still = jax.lax.stop_gradient((x.begins, x.touching))
    args = x._replace(begins=still[0], touching=still[1], stiffness=None, law=None, velocity=None)
    return jc.simulate(
        system, x.duration, position=x.position, velocity=x.velocity, args=args,
        breakpoints=x.begins[None], **how,
    )  # fmt: skip


def outcome(name: str, x: Numbers, **how: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the columns of the contacts, and whatever has no derivative."""
    run = simulated(name, x, **how)
    table = {column: getattr(run.contacts, column) for column in COLUMNS}
    lost = jnp.sum(jnp.where(run.contacts.valid, run.contacts.energy_loss, 0))
    books = run.energy[-1] - run.energy[0] - run.states.work[-1] + lost
    turnover = jnp.maximum(jnp.max(run.energy), jnp.abs(run.states.work[-1]))
    others = {"gap": run.contacts.gap, "valid": run.contacts.valid, "status": run.status}
    return table, others | {"books": books, "turnover": turnover}


@functools.cache
def program(name: str, **how: Any) -> Callable[..., Any]:
    """Return a program for the outcomes of mechanisms and their derivatives along directions."""

    def both(x: Numbers, along: Numbers) -> Any:
        return jax.jvp(lambda x: outcome(name, x, **how), (x,), (along,), has_aux=True)

    return jax.jit(lambda *pairs: jax.lax.map(lambda pair: both(*pair), pairs))


def directions(random: np.random.Generator, x: Numbers) -> Numbers:
    """Return random directions, relative to the numbers; starts keep their kind."""
    along = [leaf * random.uniform(-1, 1, np.shape(leaf)) for leaf in x]
    return Numbers(*along)._replace(touching=np.zeros_like(x.touching))


class Compared(NamedTuple):
    """The outcomes of mechanisms (N, ...). `sound`: contacts whose derivatives have a reference.
    `deviation`: that of the derivative of each column, relative to derivative and value. `books`:
    the imbalance of energy over the largest energy.
    """

    table: dict[str, np.ndarray]
    others: dict[str, np.ndarray]
    sound: np.ndarray
    deviation: dict[str, np.ndarray]
    books: np.ndarray


def outcomes(name: str, x: Numbers, along: Numbers, shift: float = 0.0, **how: Any) -> Any:
    """Return columns, their slopes along directions, and the rest, so far along them."""
    moved = jax.tree.map(lambda a, d: a + shift * d, x, along)
    return jax.tree.map(np.asarray, program(name, **how)(moved, along))


def beside_differences(runs: Iterable[Any]) -> Compared:
    """Compare the slopes of outcomes at 0, h and -h. Of values f and slopes f' at -h, 0 and h
    Simpson's rule h (f'(-h) + 4 f'(0) + f'(h))/3 is f(h) - f(-h) up to h⁵.
    """
    table, slopes, others = jax.tree.map(lambda *rows: np.stack(rows), *runs)
    valid = others["valid"][0]
    columns = others["valid"], others["gap"], np.isnan(table["duration"])
    differ = np.any([np.any(column != column[:1], axis=0) for column in columns], axis=0)
    # From the first contact on that is another one.
    same = np.cumsum(differ, axis=1) == 0
    work = np.abs(table["max_force"][0] * table["max_depth"][0])
    sizes = {c: np.abs(table[c][0]) for c in COLUMNS} | {"restitution": 1.0, "energy_loss": work}
    sound, deviation = valid & same, {}
    for column in COLUMNS:
        _, high, low = table[column]
        slope = slopes[column]
        mean = (slope[1] + 4 * slope[0] + slope[2]) / 6
        size = np.abs(slope[0]) + sizes[column]
        size = np.where(size > 0, size, 1)
        deviation[column] = np.abs(mean - (high - low) / (2 * STEP)) / size
        bends = np.abs(slope[1] - 2 * slope[0] + slope[2]) / size
        sound &= ~(bends > BENDS)
    # A kink in one contact is one in those after it.
    sound &= np.cumsum(valid & ~sound, axis=1) == 0
    table, others = ({key: value[0] for key, value in each.items()} for each in (table, others))
    turnover = np.maximum(others["turnover"], np.finfo(float).tiny)
    # A run that ends early has energies at its start only.
    books = np.where(others["status"] == 0, np.abs(others["books"]) / turnover, 0)
    return Compared(table, others, sound, deviation, books)


FORCES = {
    "HuGuo": lambda p, k, n, v0: lambda d, r: k * d**n * (1 + 1.5 * (1 - p[0]) / p[0] * r / v0),
    "ConstantDamping": lambda p, k, n, v0: lambda d, r: d**n * (k + p[0] * r),
    "LinearDashpot": lambda p, k, n, v0: lambda d, r: k * d**n + p[0] * r,
    "LinearDashpot, n = 1.5": lambda p, k, n, v0: lambda d, r: k * d**n + p[0] * r,
}
"""The forces of laws by indentation and its rate, with the speed at touch, for SciPy."""


@jax.jit
def equations(t, y, x):
    """Return q', the mass matrix, forces, gaps, their closing speeds and their gradients."""
    q, v = y[:2], y[2:]
    gaps, rates = jax.jvp(lambda t, q: gap(t, q, x), (t, q), (jnp.ones_like(t), v))
    jacobian = jax.jacfwd(lambda q: gap(t, q, x))(q)
    return v, mass(t, q, x), force(t, q, v, x), gaps, -rates, jacobian


def by_scipy(name: str, x: Numbers) -> list[tuple[int, float, float]]:
    """Return the touches (gap, time, closing speed) by DOP853, restarted at each event."""
    pull: list[Any] = [None, None]
    closed, touches, law = [False, False], [], FORCES[name]
    t, y = 0.0, np.concatenate([x.position, x.velocity])
    atol = 1e-15 * np.repeat([x.unit, x.unit / x.duration], 2)

    def at(t: float, y: np.ndarray) -> list[np.ndarray]:
        return [np.asarray(part) for part in equations(t, y, moment)]

    def right(t: float, y: np.ndarray) -> np.ndarray:
        v, inertia, total, gaps, closing, jacobian = at(t, y)
        # A dashpot acts from the touch on, which rounding may leave above zero.
        for k in np.flatnonzero(closed):
            total = total + jacobian[k] * max(pull[k](max(-gaps[k], 0), closing[k]), 0)
        return np.concatenate([v, np.linalg.solve(inertia, total)])

    def touch(k: int) -> None:
        _, _, _, _, closing, _ = at(t, y)
        closed[k], pull[k] = True, law(x.law, x.stiffness[k], LAWS[name].exponent, closing[k])
        touches.append((k, t, closing[k]))

    def event_of(k: int) -> Callable[..., float]:
        return ending(lambda t, y: at(t, y)[3][k] / x.unit, 1 if closed[k] else -1)

    moment = x
    if x.touching:
        touch(0)
    while t < x.duration and len(touches) <= MOST:
        stop = x.begins if t < x.begins else x.duration
        # Stages at the breakpoint belong to the side of their step.
        moment = x._replace(begins=np.float64(np.inf if t < x.begins else -np.inf))
        end = solve_ivp(
            right, (t, stop), y, "DOP853", rtol=1e-12, atol=atol, max_step=x.duration / 200,
            first_step=min(1e-7 * x.duration, stop - t), events=[event_of(0), event_of(1)],
        )  # fmt: skip
        t, y = end.t[-1], end.y[:, -1]
        for k in np.flatnonzero([len(times) for times in end.t_events]):
            if closed[k]:
                closed[k] = False
            else:
                touch(int(k))
    return touches


def beside_scipy(name: str, x: Numbers, count: int) -> tuple[int, float]:
    """Return how many touches have SciPy's, and their largest deviation in time and speed,
    relative to duration and speed. Pressed contacts, whose speed at touch is unknown, are left out.
    """
    chosen = [k for k in range(len(x.duration)) if k % 4 != KINDS.index("pressed")][:count]
    same, worst = 0, 0.0
    solve = eqx.filter_jit(lambda one: outcome(name, one, v0="touch", rtol=1e-11))
    for k in chosen:
        one = jax.tree.map(lambda a, k=k: a[k], x)
        table, others = jax.tree.map(np.asarray, solve(one))
        known = by_scipy(name, one)
        ours = np.flatnonzero(others["valid"])
        known = known[: len(ours)] if others["status"] == jc.Ending.TOO_MANY_IMPACTS else known
        if [g for g, _, _ in known] != list(others["gap"][ours]):
            print(f"{name} {k}: {len(known)} touches by SciPy, {len(ours)} here", flush=True)
            continue
        for row, (_, time, speed) in zip(ours, known, strict=True):
            off = abs(table["time"][row] - time) / one.duration
            worst = max(worst, off, abs(table["closing_speed"][row] - speed) / speed)
            same += 1
    return same, worst


def row_of(name: str, each: int, scipy: int) -> list[str]:
    """Return the row of a law: counts, the imbalance of energy, and the largest deviations."""
    random = np.random.default_rng(1)
    x = drawn(random, name, each)
    along = directions(random, x)
    runs = beside_differences(outcomes(name, x, along, s) for s in (0.0, STEP, -STEP))
    valid, sound = runs.others["valid"], runs.sound
    rows = {c: sound & np.isfinite(runs.table[c]) for c in COLUMNS}
    worst = [np.max(np.where(rows[c], runs.deviation[c], 0)) for c in COLUMNS]
    same, off = beside_scipy(name, x, scipy) if name in FORCES else (0, 0.0)
    counts = len(valid), valid.sum(), (valid & ~sound).sum(), np.sum(runs.others["status"] > 1)
    errors = [f"{z:.0e}" for z in [np.max(runs.books), *worst]]
    return [name, *map(str, counts), *errors, str(same or ""), f"{off:.0e}" if same else ""]


def measure(known: None, each: int, scipy: int, laws: list[str]) -> Iterator[tuple[int, list]]:
    rows = []
    for name in laws:
        rows.append(row_of(name, each, scipy))
        print(" | ".join(rows[-1]), flush=True)
        yield each, rows


def page(found: tuple[int, list[list[str]]]) -> str:
    each, rows = found
    heads = ["law", "mechanisms", "contacts", "left out", "failed", "energy", *COLUMNS]
    table = lines([*heads, "SciPy's touches", "deviation"], rows)
    return f"{HEADING.replace('{EACH}', str(each))}\n{table}"


OPTIONS = {
    "--each": {"type": int, "default": 200, "help": "mechanisms for each law"},
    "--scipy": {"type": int, "default": 20, "help": "of them beside SciPy"},
    "--laws": {"nargs": "*", "default": list(LAWS), "choices": list(LAWS)},
}
STUDY = Study(__file__, __doc__, measure, options=OPTIONS, text=page, ending=".md")

"""The tasks of benchmarks/gpu.py: what is computed, of which size, and what its error is."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from benchmarks import fit_many, weight
from benchmarks.oblique_impacts.problems import CHI, elastic, spheres
from benchmarks.oblique_impacts.problems import by_scipy as springs_by_scipy
from benchmarks.time_and_error import by_diffrax
from benchmarks.time_and_error.line_scenes import by_scipy, oblique, scene_of
from benchmarks.time_and_error.problems import PROBLEMS, SEED, Problem, function_of, worst
from jaxcontact._friction.phases import slider_phases

DRAWN = 100_000
"""Different lanes of a batch; a larger one repeats them."""
RTOL = {("event", "free"): 1e-7, ("event", "pushed"): 1e-7}
RTOL |= {("Dopri8", "free"): 1e-11, ("Dopri8", "pushed"): 1e-10}
"""The coarsest powers of ten with e and the duration within 1e-9 on a CPU."""
SLOPES = 1e-9
"""The tolerance of event solves whose derivative is taken."""
FINEST = 2.3e-14
"""The tolerance of SciPy's reference, the least that it takes."""
STEP = 0.001
"""Of the fronts of slip; see `tests/elastic_rebound.py`."""
KNOWN = 17
"""Lanes of friction whose truth is computed."""
ROOM = 64
"""Impacts of a scene at most: measured 18 in the soft scene, fewer in the other."""


def ordinary(number: Any) -> Any:
    """Return Hu and Guo's α of e from 0.99 down to 0.2."""
    e = 0.99 - 0.79 * number
    return 1.5 * (1 - e) / e


FREE = dataclasses.replace(PROBLEMS["hunt_crossley"], number=ordinary)
"""Hunt-Crossley with e from 0.99 down to 0.2."""
PUSHED = PROBLEMS["pushed"]

Job = tuple[Callable[..., Any], tuple[Any, ...]]


class Task(NamedTuple):
    """One line of the table.

    `make(size, precision, platform)` returns a function and its arguments. The function is
    compiled for them, unless `whole`: then it is called as it is. `error(size, precision, answer)`
    is relative to the truth; without it an answer is compared with the CPU's.
    """

    group: str
    what: str
    make: Callable[[int, str, str], Job]
    error: Callable[[int, str, Any], float] | None
    sizes: tuple[int, ...]
    most_on_cpu: int
    precisions: tuple[str, ...] = ("float64",)
    unit: str = "impacts"
    whole: bool = False
    quick: int = 32

    def rows(self, platforms: Sequence[str], quick: bool) -> Iterator[tuple[str, int, str]]:
        """Yield precisions, sizes and platforms. The CPU comes first: some errors need it."""
        for precision in self.precisions:
            if quick:
                sizes = on_cpu = (self.quick,)
            else:
                sizes = self.sizes
                on_cpu = tuple(x for x in sizes if x <= self.most_on_cpu) or (self.most_on_cpu,)
            for platform in platforms:
                for size in on_cpu if platform == "cpu" else sizes:
                    yield precision, size, platform


@functools.cache
def lanes(problem: Problem, size: int, precision: str) -> np.ndarray:
    """The numbers of a batch, of which the first have a truth of 40 digits."""
    return np.resize(problem.lanes(min(size, DRAWN)), size).astype(precision)


def outcome(problem: Problem, p: jax.Array, method: Any) -> tuple[jax.Array, jax.Array]:
    """e and the duration."""
    hit = problem.impact(p, method=method)
    return hit.restitution, hit.duration


def on_cpu(function: Callable[..., Any], *arguments: Any) -> Any:
    """The values of a function in float64, on the CPU."""
    with jax.default_device(jax.devices("cpu")[0]), jax.enable_x64(True):
        return jax.tree.map(np.asarray, jax.jit(function)(*arguments))


def by_method(problem: Problem, method: Any) -> Callable[[int, str, str], Job]:
    def make(size: int, precision: str, _: str) -> Job:
        return lambda p: outcome(problem, p, method), (lanes(problem, size, precision),)

    return make


def by_event(problem: Problem, name: str) -> Callable[[int, str, str], Job]:
    """Event solves at the tolerance for 1e-9, or the default of float32."""

    def make(size: int, precision: str, platform: str) -> Job:
        rtol = RTOL["event", name] if precision == "float64" else None
        return by_method(problem, jc.Event(rtol=rtol))(size, precision, platform)

    return make


def by_plain_diffrax(problem: Problem, name: str) -> Callable[[int, str, str], Job]:
    """A solve in (x, v). On a CPU it takes a thousand lanes at a time, which stay in the cache."""
    acceleration = function_of(problem.acceleration)

    def one(p: jax.Array) -> tuple[jax.Array, jax.Array]:
        return by_diffrax.impact(acceleration, (p,), RTOL["Dopri8", name], diffrax.Dopri8())

    def make(size: int, precision: str, platform: str) -> Job:
        if platform == "cpu" and size > by_diffrax.CHUNK:
            some = functools.partial(jax.lax.map, one, batch_size=by_diffrax.CHUNK)
            return some, (lanes(problem, size, precision),)
        return jax.vmap(one), (lanes(problem, size, precision),)

    return make


def of_free(size: int, precision: str, answer: Any) -> float:
    """The largest error of e and the duration: of all lanes beside the closed form in float64, and
    of the first ones beside 40 digits.
    """
    p = lanes(FREE, min(size, DRAWN), precision).astype(np.float64)
    want = on_cpu(lambda p: outcome(FREE, p, "exact"), p)
    every = (worst(got, np.resize(true, size)) for got, true in zip(answer, want, strict=True))
    return max(*every, *FREE.errors(p, answer).values())


def of_pushed(size: int, precision: str, answer: Any) -> float:
    """The largest error of the first lanes beside 40 digits."""
    known = PUSHED.errors(lanes(PUSHED, size, precision).astype(np.float64), answer)
    return max(known.values()) if all(np.isfinite(x).all() for x in answer) else np.inf


def durations(p: jax.Array, method: Any) -> jax.Array:
    return outcome(FREE, p, method)[1]


def slopes(p: jax.Array, method: Any, forward: bool) -> jax.Array:
    """The derivative of every duration by its lane's number."""
    if forward:
        return jax.jvp(lambda p: durations(p, method), (p,), (jnp.ones_like(p),))[1]
    return jax.grad(lambda p: jnp.sum(durations(p, method)))(p)


def by_mode(forward: bool) -> Callable[[int, str, str], Job]:
    def make(size: int, precision: str, _: str) -> Job:
        method = jc.Event(rtol=SLOPES)
        return lambda p: slopes(p, method, forward), (lanes(FREE, size, precision),)

    return make


def of_slopes(size: int, precision: str, answer: Any) -> float:
    """The largest error beside the derivative of the closed form, relative to the largest slope."""
    want = on_cpu(lambda p: slopes(p, "exact", True), lanes(FREE, min(size, DRAWN), "float64"))
    miss = np.max(np.abs(np.asarray(answer) - np.resize(want, size))) / np.max(np.abs(want))
    return float(miss) if np.isfinite(miss) else np.inf


def samples_of(count: int) -> dict[str, np.ndarray]:
    """Restitutions from 0.1 to 1; stiffnesses, masses and speeds over decades."""
    random = np.random.default_rng(0)
    return {
        "e": random.uniform(0.1, 1.0, count),
        "K": 10 ** random.uniform(5, 11, count),
        "m": 10 ** random.uniform(-3, 1, count),
        "v": 10 ** random.uniform(-2, 1, count),
    }


def hit(e: Any, K: Any, m: Any, v: Any, method: str = "exact") -> jc.Impact:
    return jc.impact(jc.HuGuo(e=e), jc.Contact(mass=m, stiffness=K), v, method=method)


def hit_by_event(e: Any, K: Any, m: Any, v: Any) -> dict[str, Any]:
    found = hit(e, K, m, v, "event")
    return {"restitution": found.restitution, "duration": found.duration}


def by_sweep(function: Callable[..., Any], on_a_cpu: int) -> Callable[[int, str, str], Job]:
    """`jc.sweep` over random e, K, m and v. It takes the process's own device to be in use, so a
    CPU beside a GPU is told its own size of a block.
    """

    def make(size: int, precision: str, platform: str) -> Job:
        samples = {name: x.astype(precision) for name, x in samples_of(size).items()}
        most = on_a_cpu if platform == "cpu" else None

        def run() -> tuple[Any, Any]:
            table = jc.sweep(function, samples=samples, batch_size=most, progress=False)
            return table.restitution, table.duration

        return run, ()

    return make


def of_sweep(size: int, precision: str, answer: Any) -> float:
    """The largest error of a thousand lanes beside the closed form."""
    some = {name: x[:1000] for name, x in samples_of(size).items()}
    want = on_cpu(lambda e, K, m, v: (lambda x: (x.restitution, x.duration))(hit(e, K, m, v)),
                  *some.values())  # fmt: skip
    return max(worst(got, true) for got, true in zip(answer, want, strict=True))


@functools.cache
def three_discs() -> dict[str, Any]:
    """The scene of `weight.py`, which keeps it as text for fresh processes."""
    names: dict[str, Any] = {}
    exec(weight.OURS, names)
    return names


def by_scene(instantaneous: bool) -> Callable[[int, str, str], Job]:
    """Three discs and a plane, for one second; the first disc has another speed in each scene."""
    known = three_discs()

    def one(speed: jax.Array) -> tuple[jax.Array, ...]:
        scene = known["scene"](known["three"], speed)
        run = jc.simulate(scene, 1.0, instantaneous=instantaneous, max_impacts=ROOM)
        return run.position[-1], run.velocity[-1], run.status

    def make(size: int, precision: str, _: str) -> Job:
        return jax.vmap(one), (np.random.default_rng(SEED).uniform(-1, 1, size).astype(precision),)

    return make


def by_mechanism(
    name: str, duration: float, number: str, least: float, most: float
) -> Callable[[int, str, str], Job]:
    """A ready-made mechanism, with another value of one of its numbers in each lane."""

    def one(value: jax.Array) -> tuple[jax.Array, ...]:
        system, start = getattr(jc.systems, name)(**{number: value})
        run = jc.simulate(system, duration, **start, v0="touch", max_impacts=16)
        return run.position[-1], run.velocity[-1], run.status

    def make(size: int, precision: str, _: str) -> Job:
        drawn = np.random.default_rng(SEED).uniform(least, most, size)
        return jax.vmap(one), (drawn.astype(precision),)

    return make


def by_pair(slowness: float) -> Callable[[int, str, str], Job]:
    """Two spheres that pass each other, each pair with its own speed."""
    pair = oblique(slowness)

    def one(speed: jax.Array) -> tuple[jax.Array, jax.Array]:
        velocity = jnp.stack([jnp.stack([speed, 0 * speed]), jnp.zeros(2, speed.dtype)])
        run = jc.simulate(scene_of(pair, velocity), pair.duration, v0="touch", max_impacts=2)
        return run.velocity[-1], run.status

    return lambda size, precision, _: (jax.vmap(one), (speeds(size).astype(precision),))


def by_fit_many(size: int, precision: str, _: str) -> Job:
    """c and its power of e(v), of a table of 20 points for each ball."""
    v, e, _ = fit_many.tables(size)

    def run() -> tuple[np.ndarray, np.ndarray]:
        many = jc.fit_many(fit_many.predict, e, fit_many.START, x=v, **fit_many.HOW)
        return many.values, np.stack([*many.standard_errors.values()], axis=1)

    return run, ()


def of_fits(size: int, precision: str, answer: Any) -> float:
    """The largest difference of three balls from `jc.fit`, in standard errors."""
    v, e, _ = fit_many.tables(size)
    values, errors = answer
    found = []
    with jax.default_device(jax.devices("cpu")[0]):
        for k in range(min(size, 3)):
            fit = jc.fit(fit_many.predict, e[k], fit_many.START, x=v[k], **fit_many.HOW)
            found.append(np.max(np.abs(values[k] - fit.values) / errors[k]))
    return float(max(found))


def speeds(size: int) -> np.ndarray:
    return np.random.default_rng(SEED).uniform(1.2, 1.6, size)


def of_pair(slowness: float) -> Callable[[int, str, Any], float]:
    """The largest error of three pairs beside SciPy, relative to the speed."""
    pair = oblique(slowness)

    def error(size: int, precision: str, answer: Any) -> float:
        velocity, status = (np.asarray(x) for x in answer)
        if np.any(status != jc.Ending.COMPLETED):
            return np.inf
        found = []
        for k, speed in enumerate(speeds(size)[:3]):
            start = np.array([[speed, 0.0], [0.0, 0.0]])
            want = by_scipy(pair._replace(velocity=start), FINEST)
            found.append(np.max(np.abs(velocity[k].ravel() - want)) / speed)
        return float(max(found))

    return error


def by_curve(size: int, precision: str, _: str) -> Job:
    """ψ2 of Maw, Barber and Fawcett's table for spheres of one kind."""
    psi = np.resize(elastic(min(size, DRAWN)), size).astype(precision)
    return lambda psi: jc.tangential_rebound(psi, CHI, 0.0), (psi,)


def of_curve(size: int, precision: str, answer: Any) -> float:
    """The largest error of the first lanes beside springs whose slip is followed by its fronts."""
    # Numba comes with [benchmarks]; what needs no fronts of slip runs without it.
    from tests.elastic_rebound import rebounds

    psi = elastic(min(size, DRAWN))[:KNOWN].astype(precision).astype(np.float64)
    return float(np.max(np.abs(np.asarray(answer)[: len(psi)] - rebounds(psi, CHI, STEP))))


def by_spring(size: int, precision: str, _: str) -> Job:
    """ψ2 of a spring and slider, each lane with its own χ and e."""
    lanes = spheres(min(size, DRAWN))
    numbers = (np.resize(x, size).astype(precision) for x in (lanes.psi, lanes.chi, lanes.alpha))

    def rebound(psi: jax.Array, chi: jax.Array, alpha: jax.Array) -> jax.Array:
        return slider_phases(psi, chi, alpha, "force").psi2

    return rebound, tuple(numbers)


def of_spring(size: int, precision: str, answer: Any) -> float:
    """The largest error of the first lanes beside SciPy with events."""
    lanes = spheres(min(size, DRAWN)).first(KNOWN)
    lanes = lanes._replace(
        **{k: x.astype(precision).astype(float) for k, x in lanes._asdict().items()}
    )
    return float(
        np.max(np.abs(np.asarray(answer)[: len(lanes.psi)] - springs_by_scipy(lanes, FINEST)()))
    )


BOTH = "float64", "float32"
TENS = tuple(10**k for k in range(8))
TASKS = (
    Task("impacts", "exact", by_method(FREE, "exact"), of_free, TENS[3:], TENS[6], BOTH),
    Task("impacts", "event", by_event(FREE, "free"), of_free, TENS[3:7], TENS[5], BOTH),
    Task("impacts", "event, with a push", by_event(PUSHED, "pushed"), of_pushed, TENS[3:7:2],
         TENS[5]),
    Task("impacts", "plain diffrax, Dopri8", by_plain_diffrax(FREE, "free"), of_free, (TENS[5],),
         TENS[5]),
    Task("impacts", "plain diffrax, Dopri8, with a push", by_plain_diffrax(PUSHED, "pushed"),
         of_pushed, (TENS[5],), TENS[5]),
    Task("friction", "table of Maw, Barber and Fawcett", by_curve, of_curve, TENS[3:8:2], TENS[5],
         BOTH),
    Task("friction", "spring and slider", by_spring, of_spring, TENS[3:7], TENS[5], BOTH),
    Task("gradients", "event, forward", by_mode(True), of_slopes, (TENS[5],), TENS[5]),
    Task("gradients", "event, reverse", by_mode(False), of_slopes, (TENS[5],), TENS[5]),
    Task("sweeps", "jc.sweep of everything in closed form", by_sweep(hit, 1 << 14), of_sweep,
         (TENS[6],), TENS[6], whole=True),
    Task("sweeps", "jc.sweep of event solves", by_sweep(hit_by_event, 1 << 9), of_sweep, (TENS[6],),
         TENS[5], whole=True),
    Task("scenes", "instantaneous", by_scene(True), None, (1, 100, 1_000, 10_000), 1_000,
         unit="scenes", quick=2),
    Task("scenes", "soft", by_scene(False), None, (1, 100, 1_000, 10_000), 100, unit="scenes",
         quick=2),
    Task("mechanisms", "slider-crank, 1.6 ms",
         by_mechanism("slider_crank", 1.6e-3, "clearance", 0.4e-3, 0.6e-3), None,
         (1, 100, 1_000, 10_000), 100, unit="runs", quick=2),
    Task("mechanisms", "double pendulum, 2.5 s",
         by_mechanism("double_pendulum", 2.5, "wall", -0.32, -0.28), None,
         (1, 100, 1_000, 10_000), 100, unit="runs", quick=2),
    Task("fits", "jc.fit_many of e(v)", by_fit_many, of_fits, (100, 1_000, 10_000), 1_000,
         unit="balls", whole=True, quick=2),
    Task("oblique pairs", "slightly oblique", by_pair(4e-3), of_pair(4e-3), (TENS[5],), 1_000,
         quick=4),
    Task("oblique pairs", "oblique", by_pair(0.1), of_pair(0.1), (TENS[5],), 1_000, quick=4),
)  # fmt: skip
"""The CPU takes the sizes up to its largest, or that size alone."""

"""The text of the page for each group, and the errors of its tables."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from .derivatives import CHECKED as CHECKED_SLOPES
from .derivatives import WAYS as SLOPE_WAYS
from .derivatives import Slopes
from .engine_words import law_and_step
from .engines import TASKS as REBOUNDS
from .engines import WAYS as ENGINE_WAYS
from .fit_tasks import Record, Table
from .fits import WAYS as FIT_WAYS
from .impacts import WAYS as IMPACT_WAYS
from .problems import CHECKED, PROBLEMS
from .reading import Row
from .rebounds import ASKED
from .scenes import SCENES
from .scenes import WAYS as SCENE_WAYS


class Section(NamedTuple):
    """A group of rows: its title, words, the titles of its problems, unit, and errors asked for."""

    group: str
    title: str
    words: str
    titles: dict[str, str]
    unit: str
    errors: tuple[float, ...]
    options: str = ""
    """The group of rows that its options were chosen by."""
    swept: str = ""
    """On what they were swept."""
    batch: str = "batch of"
    """What its numbers of lanes mean."""
    ways: tuple[str, ...] = ()
    """All that it compares, so that the page can say what is not measured yet."""
    more: Callable[[list[Row]], list[str]] = lambda rows: []
    """What else the page says of the rows, below the tables."""


_IMPACTS = f"""\
Restitution and duration of one impact, solved in batches of 1, 100 and 100,000: the laws of
Hunt-Crossley, of a linear spring and dashpot, of Kuwabara and Kono, one of a user's own
(δ^1.5 + δ^2.5 + c δ δ', written as `force` and nothing else), and Hertz's with a constant push.
Damping or push differ from lane to lane; {CHECKED} lanes spread over the whole range have a known
truth. Where fewer lanes were measured than are in the batch, time is in proportion. The peers solve
the scaled problem, so that units are no trouble to them. *exact*, *phase* and *event* are
`jc.impact` in a `jax.jit`; its other results are not asked for. diffrax ends by an event on its
interpolant, SciPy likewise. numba repeats the last step until it ends at zero; *regularised* is
what an expert would write, in w = √δ and dτ = dt/w. Verlet and Euler make steps of one length."""

_DERIVATIVES = f"""\
All six derivatives of restitution and duration by e, K and n, a law of Hunt and Crossley with
Hu and Guo's relation between e and damping, e from 0.1 to 0.95. Truth: differences of the
oracle of 40 digits, which keep 20 of them, on {CHECKED_SLOPES} lanes; errors relative to the
largest derivative of that result. Forward: `jax.jacfwd`, reverse: `jax.jacrev`. Differences are
central, six solves."""

_ENGINES = f"""\
A ball of 1 kg strikes a plane at 4.2 m/s, without gravity, and must rebound at the e that was
asked: {", ".join(f"{e:g}" for e in ASKED)}. Every engine with its own contact, in two ways. *As its
documents say*: Exudyn (impact model 2) and LAMMPS (`coeff_restitution`) take e; MuJoCo and MJX take
a damping ratio, here that of an oscillator with this e; Drake and JaxSim (exponents of Hunt and
Crossley's force) take a damping, here (3/2)(1 - e)/v, from the paper that they name. *Numbers by
jaxcontact*: those of `jc.export`, and JaxSim's from the same closed relation. The error of the law
is what is left of the engine's documented formula, solved by SciPy, without steps; that of the step
is between the engine and its formula; the tables count the larger one. The ball touches at another
part of a step for each e. Times are of the steps alone, a model is made before; they are for the
contact and a third more. Exudyn, MuJoCo and Drake throw one ball after another, LAMMPS a hundred
in a box for each e, MJX and JaxSim all at once. JaxSim has contacts of points only: a box on four
corners. *ExactRestitution* is `jc.impact` in a `jax.jit`."""

_FITS = """\
Numbers from data without noise, so that what is missing to the truth is the way's: c of the law
of Hunt and Crossley from 20 and 1000 restitutions (of 40 digits) over speed; c, K, the moment of
touch and the zero error from a force of 2000 samples (by SciPy from sample to sample at its least
tolerance). Errors are relative, of the worst number. All start at seven tenths of the truth, but
`jc.fit_damping`, which finds its own start, and the touch, which all find alike. Peers: SciPy's
`least_squares` and lmfit, by differences with steps that the tolerance allows, over `solve_ivp`
(DOP853; of the table point after point, on as many points as the column says, in proportion)
and over numba (8(5,3); of the table regularised)."""

_SCENES = """\
Whole runs from start to end. Soft balls, whose impacts take time and overlap: five unequal ones in
a line, ten equal ones that touch (Hertz, a blow at the end), and a pair that passes (ε: how far it
slides in an impact, of its diameter); final velocities, beside SciPy at its least tolerance. A ball
that bounces to rest, with its weight in the contact: the time of rest, beside 40 digits. Out of
time: a ball on a shaking table, beside sampling and Brent's method, and gases of 32 discs, in a
periodic cell and between four walls, beside a search in extended precision; final velocities. SciPy
and diffrax restart at touches and openings. Through flights diffrax has a longest step, found by
trial, without which it misses contacts (of the shortest ones, at ε = 0.001, with it, too), and both
have one in the gases and over the table. By hand means numba code for this scene and no other.
Exudyn (RK44, impact model 1, whose law this is) and MuJoCo make steps of one length; their times
have the building of the model in them. MuJoCo goes through the line with contacts of 5 ms.
*billiards* is the one simulator of hard discs from event to event that PyPI has; it knows no
periodic cell, hence the box."""

SECTIONS = (
    Section(
        "impacts",
        "One impact",
        _IMPACTS,
        {name: problem.title for name, problem in PROBLEMS.items()},
        "µs an impact",
        (1e-4, 1e-6, 1e-9, 1e-12),
        "options",
        "the Hunt-Crossley law, in the largest batch",
        ways=tuple(way.name for way in IMPACT_WAYS),
    ),
    Section(
        "derivatives",
        "Derivatives",
        _DERIVATIVES,
        {Slopes.name: Slopes.title},
        "µs an impact",
        (1e-4, 1e-7, 1e-10),
        "slope options",
        "the largest batch",
        ways=tuple(way.name for way in SLOPE_WAYS),
    ),
    Section(
        "engines",
        "Engines",
        _ENGINES,
        {task.name: task.title for task in REBOUNDS},
        "µs a rebound",
        (1e-1, 1e-2, 1e-3, 1e-6),
        "engine options",
        "numbers by jaxcontact, five balls",
        "balls:",
        ways=tuple(way.name for way in ENGINE_WAYS),
        more=law_and_step,
    ),
    Section(
        "scenes",
        "Scenes",
        _SCENES,
        {scene.name: scene.title for scene in SCENES},
        "ms a run",
        (1e-4, 1e-9),
        ways=tuple(way.name for way in SCENE_WAYS.values()),
    ),
    Section(
        "fits",
        "Fits",
        _FITS,
        {task.name: task.title for task in (Table(), Record())},
        "ms a fit",
        (1e-4, 1e-8),
        "fit options",
        "the table of 20 points",
        "points:",
        ways=tuple(way.name for way in FIT_WAYS),
    ),
)

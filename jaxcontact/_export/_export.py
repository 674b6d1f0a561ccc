"""The front door: which engine, with which options."""

from __future__ import annotations

from collections.abc import Callable

import jax
from jaxtyping import ArrayLike

from .._contact import Contact
from .._impact import impact
from .._laws import AbstractLaw
from .._parameter import POSITIVE, as_parameter
from ._lammps import lammps
from ._mujoco import mujoco
from ._multibody import drake, exudyn, simbody
from ._result import Export
from ._wanted import Draft, solved, wanted_of

# Each engine with the options it takes; those marked True it cannot do without.
ENGINES: dict[str, tuple[Callable[..., Draft], dict[str, bool]]] = {
    "drake": (drake, {}),
    "exudyn": (exudyn, {"impact_model": False}),
    "lammps": (lammps, {"radius": True, "damping": False}),
    "mujoco": (mujoco, {}),
    "simbody": (simbody, {"radius": True}),
}

# The event solve is good to 1e-8 in e; the rest are closed forms.
_AGREEMENT = 1e-6


def export(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    *,
    engine: str,
    radius: float | None = None,
    damping: str | None = None,
    impact_model: int | None = None,
) -> Export:
    """The parameters with which another simulator delivers the restitution of a law at one speed.

    The wanted e is that of `impact(law, contact, velocity)`. The engine's own contact law is
    inverted for it, and then solved again with the parameters found. Engines: "drake",
    "exudyn", "lammps", "mujoco", "simbody". The stiffness is the contact's where the engine has its
    exponent, and otherwise the one with which its contact lasts as long as the law's.

    Arguments: scalars `law`, `contact`, and the closing `velocity` in m/s. `radius` in m, for
    LAMMPS and Simbody, the effective one, R1 R2/(R1+R2), or that of a sphere on a plane. `damping`,
    for LAMMPS: "coeff_restitution" (default), "tsuji", "tsuji_sqrt2" or "viscoelastic".
    `impact_model`, for Exudyn: 2 (default) or 1.

    Returns an `Export`. Computes in double precision whatever JAX is set to, and is not for use
    under `jit`. Raises ValueError for an unknown engine, an option it does not take, an impact
    that is not solved or has no rebound, or a restitution that the engine's law cannot deliver.
    Source: `Export.source`, for each engine.
    """
    if engine not in ENGINES:
        known = ", ".join(map(repr, ENGINES))
        raise ValueError(f"Argument `engine` must be one of {known}, but is {engine!r}.")
    build, takes = ENGINES[engine]
    options = {"radius": radius, "damping": damping, "impact_model": impact_model}
    for name, value in options.items():
        if value is None and takes.get(name, False):
            raise ValueError(f"Argument `{name}` is needed for engine {engine!r}, but is None.")
        if value is not None and name not in takes:
            raise ValueError(
                f"Argument `{name}` must be None for engine {engine!r}, which has no use for it, "
                f"but is {value!r}."
            )
    if radius is not None:
        options["radius"] = float(as_parameter(radius, "radius", POSITIVE))
    with jax.enable_x64(True):
        wanted = wanted_of(law, contact, velocity)
        given = {name: value for name, value in options.items() if value is not None}
        draft = build(wanted, **given)
        hit = solved(impact(draft.law, draft.contact, wanted.velocity))
    delivered = float(hit.restitution)
    duration = float(hit.duration)
    if not abs(delivered / wanted.restitution - 1) < _AGREEMENT:
        raise RuntimeError(
            f"The law of engine {engine!r} delivers {delivered:.9g} with the parameters found, not "
            f"{wanted.restitution:.9g}."
        )
    return Export(
        engine=engine,
        model=draft.model,
        parameters=draft.parameters,
        units=draft.units,
        snippet=draft.snippet,
        target=wanted.restitution,
        delivered=delivered,
        duration=duration,
        time_step=None if draft.steps is None else duration / draft.steps,
        expected_error=draft.expected_error,
        limit=draft.limit,
        source=draft.source,
        law=draft.law,
        contact=draft.contact,
    )

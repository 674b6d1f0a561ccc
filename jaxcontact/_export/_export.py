"""The front door: from a law to the parameters of an engine."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
from jaxtyping import ArrayLike

from .._contact import Contact
from .._impact import impact, problem_of
from .._laws import AbstractLaw
from ._engine import engine_of
from ._result import Export
from ._wanted import Wanted, solved

# The event solve is good to 1e-8 in e; the rest are closed forms.
_AGREEMENT = 1e-6


def export(
    law: AbstractLaw, contact: Contact, velocity: ArrayLike, *, engine: str, **options: Any
) -> Export:
    """The parameters with which another simulator delivers the restitution of a law at one speed.

    The wanted e is that of `impact(law, contact, velocity)`. The engine's own contact law is
    inverted for it, and then solved again with the parameters found. Engines: "drake",
    "exudyn", "lammps", "mujoco", "simbody". The stiffness is the contact's where the engine has its
    exponent, and otherwise the one with which its contact lasts as long as the law's.

    Arguments: scalars `law`, `contact`, and the closing `velocity` in m/s. Options of the engine:
    `radius` in m, needed for LAMMPS and Simbody, the effective one, R1 R2/(R1+R2), or that of a
    sphere on a plane; `damping`, for LAMMPS: "coeff_restitution" (default), "tsuji", "tsuji_sqrt2"
    or "viscoelastic"; `impact_model`, for Exudyn: 2 (default) or 1.

    Returns an `Export`. Computes in double precision whatever JAX is set to, and is not for use
    under `jit`. Raises ValueError for an unknown engine, an option that it does not take or lacks,
    an impact that is not solved or has no rebound, or a restitution that the engine's law cannot
    deliver. Source: `Export.source`, for each engine.
    """
    simulator = engine_of(engine)
    given = simulator.checked(options)
    with jax.enable_x64(True):
        if shape := problem_of(law, contact, velocity).shape:
            raise ValueError(
                "Arguments `law`, `contact` and `velocity` must be scalars, but have the shape "
                f"{shape}; export lane by lane."
            )
        hit = solved(impact(law, contact, velocity))
        numbers = hit.restitution, hit.duration, contact.mass, contact.stiffness, contact.exponent
        wanted = Wanted(*map(float, numbers), velocity=float(np.asarray(velocity)))
        draft = simulator.draft(wanted, **given)
        hit = solved(impact(draft.law, draft.contact, wanted.velocity))
    delivered = float(hit.restitution)
    if not abs(delivered / wanted.restitution - 1) < _AGREEMENT:
        raise RuntimeError(
            f"The law of engine {engine!r} delivers {delivered:.9g} with the parameters found, not "
            f"{wanted.restitution:.9g}."
        )
    return Export(
        **vars(draft),
        engine=engine,
        target=wanted.restitution,
        delivered=delivered,
        duration=float(hit.duration),
    )

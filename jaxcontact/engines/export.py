"""The public function `export`: from a law to the parameters of an engine."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any, Protocol

import jax
import numpy as np
from jaxtyping import ArrayLike, Float
from scipy.optimize import root_scalar

from .. import AbstractLaw, Contact, Status, impact
from ..extend import as_numbers, problem_of
from .engine import Draft, Wanted, engine_of, require_rebound
from .result import Export

_HALVINGS = 40
_XTOL = 1e-11
_SAME = 1e-9
"""Largest error of e of a law that is the wanted one, solved by the same formula."""


def compromise(
    draft: Callable[[Wanted], Draft],
    wanted: Wanted,
    speeds: Float[np.ndarray, " n"],
    targets: Float[np.ndarray, " n"],
) -> Draft:
    """Return the draft with the smallest maximum error of e over the speeds.

    An engine's parameters form one family, indexed by the e delivered at `wanted.velocity`. e at
    every other speed rises with it. At the optimum the largest errors above and below the targets
    are equal: max(e - e*) + min(e - e*) = 0, which has one root.
    """

    def errors_of(made: Draft) -> Float[np.ndarray, " n"]:
        return np.asarray(impact(made.law, made.contact, speeds).restitution) - targets

    def excess(e: float) -> float:
        errors = errors_of(draft(dataclasses.replace(wanted, restitution=e)))
        return float(errors.max() + errors.min())

    # An engine with the same law has no family: its parameters do not depend on the e.
    if np.abs(errors_of(made := draft(wanted))).max() <= _SAME:
        return made
    low, high = float(targets.min()), float(targets.max())
    for _ in range(_HALVINGS):
        if not excess(low) > 0:
            break
        low /= 2
    for _ in range(_HALVINGS):
        if not excess(high) < 0:
            break
        # If e falls faster with speed than the targets, the best law is elastic at low speeds.
        high = 1 - (1 - high) / 2
    best = low if low >= high else root_scalar(excess, bracket=(low, high), xtol=_XTOL).root
    return draft(dataclasses.replace(wanted, restitution=best))


# The event solve is accurate to 1e-8 in e; the other solves are closed forms.
_AGREEMENT = 1e-6


class Calibrated(Protocol):
    """A calibration: a law identified from a recording."""

    def __export__(
        self, contact: Contact | None
    ) -> tuple[AbstractLaw, Contact, Float[np.ndarray, " n"]]:
        """Return the law, the contact, and closing speeds in m/s over the measured range.

        Raises ValueError that names the unknown numbers of the contact.
        """
        ...


def export(
    law: AbstractLaw | Calibrated,
    contact: Contact | None = None,
    velocity: ArrayLike | None = None,
    *,
    engine: str,
    **options: Any,
) -> Export:
    """Compute the parameters with which another simulator delivers the restitution of a law.

    The wanted e is that of `impact(law, contact, velocity)`. The engine's own contact law is
    inverted for it and solved again with the parameters found. For several speeds, the export
    minimises the largest error of e with one set of parameters. Engines: "adams", "bullet",
    "chrono", "drake", "exudyn", "lammps", "mercurydpm", "mujoco", "newton", "simbody", "yade".
    Laws that an engine has itself keep their force: `DMT` in LAMMPS, and `Luding` and `WaltonBraun`
    in Exudyn (slope 0) and MercuryDPM (ratio 1 or slope 0).

    The stiffness is the contact's if the engine has the same exponent. Otherwise it is chosen to
    match the duration of contact, at the one speed or at the geometric mean of the smallest and the
    largest. The time step is that of the engine's measured steps per contact (`Export.time_step`);
    `Export.at_time_step` serves another one.

    Arguments: scalars `law` and `contact`, and the closing `velocity` in m/s, one or several (n,).
    The law may be a calibration (`Calibration`, or the result of `load_calibration`). Its contact,
    which must include mass and stiffness, is used if `contact` is None, and its measured speeds if
    `velocity` is None.

    Options of the engines:

    - `radius` in m, required for Chrono, LAMMPS, Simbody and YADE: the effective radius R1
      R2/(R1+R2), or that of a sphere on a plane. MercuryDPM needs it for a law with a slope.
    - `poisson_ratio`, for Chrono and YADE: 0.3 by default.
    - `damping`, for LAMMPS: "coeff_restitution" (default), the same with "limit_damping", "tsuji",
      "tsuji_sqrt2", "viscoelastic" or, with a hooke contact, "mass_velocity".
    - `discrete_contact_approximation`, for Drake: "lagged" (default), "similar" or "sap".
    - `impact_model`, for Exudyn: 2 (default), 1, or 0, a spring with a dashpot; 1 and 2 for the
      restitution of a `Luding`, too.
    - `d` in m, for Adams: the depth of the full damping. The default is that of a `StepDamping`,
      and for other laws 1 % of the largest indentation without damping.
    - `length`, for Adams: "m" (default) or "mm".

    Returns an `Export`. Computes in double precision for any setting of JAX; cannot be used under
    `jit`. Raises ValueError for an unknown engine, an unknown or missing option, and an impact that
    is not solved or has no rebound. It is also raised for a calibration without mass or stiffness,
    for a restitution that the engine's law cannot deliver, and for a `JKR` in LAMMPS. Source:
    `Export.source`, for each engine.
    """
    simulator = engine_of(engine)
    extra = simulator.check_options(options)
    with jax.enable_x64(True):
        law, contact, closing = _law_and_speeds(law, contact, velocity)
        if shape := problem_of(law, contact, 1.0).shape:
            raise ValueError(
                "Arguments `law` and `contact` must be scalars, but have the shape "
                f"{shape}; export lane by lane."
            )
        if shape := problem_of(law, contact, closing).shape:
            speeds, targets = _wanted_at(law, contact, closing, shape)
            middle = math.sqrt(float(speeds.min()) * float(speeds.max()))
        else:
            speeds, targets = None, None
            middle = float(np.asarray(closing))
        hit = require_rebound(impact(law, contact, middle, throw=False))
        numbers = hit.restitution, hit.duration, contact.mass, contact.stiffness, contact.exponent
        wanted = Wanted(*map(float, numbers), velocity=middle, law=law)
        if speeds is None or targets is None:
            draft = simulator.draft(wanted, **extra)
        else:
            draft = compromise(lambda aim: simulator.draft(aim, **extra), wanted, speeds, targets)
        hit = require_rebound(impact(draft.law, draft.contact, middle, throw=False))
        if speeds is not None:
            delivered = np.asarray(impact(draft.law, draft.contact, speeds).restitution)
    if speeds is None:
        delivered = float(hit.restitution)
        if not abs(delivered / wanted.restitution - 1) < _AGREEMENT:
            raise RuntimeError(
                f"The law of engine {engine!r} delivers {delivered:.9g} with the parameters found, "
                f"not {wanted.restitution:.9g}."
            )
    return Export(
        **vars(draft),
        engine=engine,
        velocity=middle if speeds is None else speeds,
        target=wanted.restitution if targets is None else targets,
        delivered=delivered,
        duration=float(hit.duration),
        _wanted=(law, contact),
    )


def _law_and_speeds(law: Any, contact: Any, velocity: Any) -> tuple[AbstractLaw, Contact, Any]:
    """Return the law, the contact and the speeds, from a calibration if one is given."""
    if hasattr(law, "__export__"):
        law, contact, measured = law.__export__(contact)
        velocity = measured if velocity is None else velocity
    if velocity is None:
        raise ValueError("Argument `velocity` is needed without a calibration, but is None.")
    return law, contact, velocity


def _wanted_at(
    law: AbstractLaw, contact: Contact, velocity: ArrayLike, shape: tuple[int, ...]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return several speeds and the law's e there. Raises ValueError for one without a rebound."""
    if len(shape) != 1 or 0 in shape:
        raise ValueError(
            "Argument `velocity` must be one speed, or several of the shape (n,), but has the "
            f"shape {shape}."
        )
    speeds = as_numbers(velocity, "velocity")
    hits = impact(law, contact, speeds)
    targets = np.asarray(hits.restitution)
    bad = (np.asarray(hits.status) != Status.SEPARATED) | ~(targets > 0)
    if bad.any():
        k = int(np.argmax(bad))
        status = Status(int(np.asarray(hits.status)[k])).name.lower()
        raise ValueError(
            "Argument `velocity` must hold speeds at which the law has a rebound, but at "
            f"{speeds[k]:g} m/s its impact ended as {status!r} with the restitution {targets[k]:g}."
        )
    return speeds, targets

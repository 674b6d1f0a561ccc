"""The package: MBF's table, phases of a spring and slider, and whole impacts."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from jaxcontact._friction.phases import slider_phases

from .problems import MOBILITY, MU, Lanes

Call = Callable[[], jax.Array]


def _ready(function: Callable, *numbers: np.ndarray) -> Call:
    program, given = jax.jit(function), [jnp.asarray(x) for x in numbers]
    return lambda: program(*given)


def mbf(psi: np.ndarray, chi: np.ndarray | float, alpha: np.ndarray | float) -> Call:
    if np.ndim(chi) == 0:
        return _ready(lambda p: jc.tangential_rebound(p, chi, alpha), psi)
    return _ready(jc.tangential_rebound, psi, chi, alpha)


def mbf_slope(psi: np.ndarray, chi: np.ndarray | float, alpha: np.ndarray | float) -> Call:
    """ψ2 and its derivative by ψ1."""

    def both(p, *others):
        def of(q):
            return jc.tangential_rebound(q, *(others or (chi, alpha)))

        return jax.jvp(of, (p,), (jnp.ones_like(p),))

    return _ready(both, psi, *(() if np.ndim(chi) == 0 else (chi, alpha)))


def phases(lanes: Lanes, form: str) -> Call:
    def psi2(psi, chi, alpha):
        return slider_phases(psi, chi, alpha, form).psi2

    return _ready(psi2, lanes.psi, lanes.chi, lanes.alpha)


def phases_slope(lanes: Lanes, form: str) -> Call:
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

"""The plot of a law: its loop, the restitution it delivers, its damping factor."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from .._contact import Contact, require_contact
from .._entry import POSITIVE, ranges, require_number
from .._impact import restitution, restitution_is_constant, trajectory
from .._laws import AbstractLaw, require_law
from .._text.units import label as words_of
from ._drawing.labels import put_label
from ._drawing.style import GUIDE, axes_for, legend_above, require_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SAMPLES = 400
_FINE = 97
_LEAST_E = 0.05
"""Below it the damping factors of most laws diverge."""

_AROUND = 30.0
"""The plotted speeds range from the given speed over this factor to the speed times it."""

_USUAL_EXPONENT = 1.5


def law(
    law: AbstractLaw,
    contact: Contact | None = None,
    velocity: float | None = None,
    *,
    ax: Any = None,
    label: str | None = None,
) -> np.ndarray:
    """Draw a law: its force over the indentation, the e it delivers, and its damping factor.

    The first plot is the loop of a free impact, m δ'' = -F(δ, δ'), whose area is the energy lost.
    The second is the delivered e over the law's parameter e, the third the α of F = K δⁿ (1 + α
    δ'/v0). A dot marks the law itself, and a thin line the e asked for. For a law without such a
    parameter, or with a speed-dependent e, the abscissa is the closing speed. It ranges from a
    thirtieth to thirty times the given one.

    Arguments: a `law` of scalars; its `contact` and a closing `velocity` in m/s, required if e
    depends on them; `ax`, three axes to draw on, new ones if None; a `label` for the legend, the
    law itself by default. Without a contact the loop is drawn relative to its largest force and
    indentation. Pass the axes of another law to draw both. Returns the three axes, (3,). Raises
    ValueError for a law that needs a contact, an array of laws, an impact without an end, and for
    anything but a law, contact, number and axes.
    """
    require_law(law)
    require_label(label)
    if contact is not None:
        require_contact(contact)
    if any(np.ndim(leaf) for leaf in jax.tree.leaves((law, contact))):
        raise ValueError(
            f"Arguments `law` and `contact` must hold scalars, but are {law!r}, {contact!r}."
        )
    if velocity is not None:
        velocity = require_number("velocity", velocity, POSITIVE)
    pictures = None if ax is None else axes_for(ax, 3, "picture")
    with jax.enable_x64(True):
        delivered = float(restitution(law, contact, velocity))
        has_e = "e" in ranges(law) and restitution_is_constant(law, contact)
        places, laws, speeds = _range(law, has_e, velocity)
        curve = np.broadcast_to(restitution(laws, contact, speeds), places.shape)
        damping = _damping(laws, contact, speeds)
        factors = _damping(law, contact, velocity)
        path = _path(law, contact, velocity)
    loop, e_axes, alpha_axes = axes = pictures or axes_for(None, 3, "picture")
    x, y = np.asarray(path.indentation), np.asarray(path.force)
    x, y = (x, y) if contact is not None else (x / x.max(), y / y.max())
    (line,) = loop.plot(x, y, label=repr(law) if label is None else label)
    style = {"color": line.get_color(), "ls": line.get_linestyle()}
    here = float(law.e) if has_e else velocity  # pyright: ignore[reportAttributeAccessIssue]
    e_axes.plot(places, curve, **style)
    if has_e:
        e_axes.axline((0, 0), slope=1, color=GUIDE, lw=0.8, zorder=1)
    if damping is not None and factors is not None:
        positive = damping > 0
        alpha_axes.plot(places[positive], damping[positive], **style)
        if positive.any():
            alpha_axes.set_yscale("log")
    for axes_at, height in ((e_axes, delivered), (alpha_axes, factors)):
        if here is not None and height is not None and (height > 0 or axes_at is e_axes):
            axes_at.plot(here, height, "o", color=line.get_color(), ms=5, zorder=3)
    _words(axes, contact, has_e)
    return np.array(axes)


def _range(
    law: AbstractLaw, has_e: bool, velocity: float | None
) -> tuple[np.ndarray, AbstractLaw, Any]:
    """Return the abscissa of the second and third plot, with the laws and the speeds there."""
    if has_e:
        e = np.linspace(_LEAST_E, 1.0, _FINE)
        return e, dataclasses.replace(law, e=e), velocity
    middle = 1.0 if velocity is None else velocity
    speeds = middle * np.geomspace(1 / _AROUND, _AROUND, _FINE)
    return speeds, law, speeds


def _damping(law: AbstractLaw, contact: Contact | None, velocity: Any) -> Any:
    """Return the damping factor; None for a law of another form."""
    try:
        factor = np.asarray(law.damping_factor(contact, velocity))
    except ValueError:
        return None
    return np.broadcast_to(factor, np.shape(velocity)) if factor.ndim == 0 else factor


def _path(law: AbstractLaw, contact: Contact | None, velocity: float | None) -> Any:
    if contact is None:
        exponent = law.exponents[0] if law.exponents else _USUAL_EXPONENT
        contact = Contact(mass=1.0, stiffness=1.0, exponent=exponent)
    path = trajectory(law, contact, 1.0 if velocity is None else velocity, samples=_SAMPLES)
    if not np.isfinite(np.asarray(path.force)).all():
        raise ValueError(
            f"Argument `law` must have an impact that ends, but that of {law!r} has none."
        )
    return path


def _words(axes: list[Axes], contact: Contact | None, has_e: bool) -> None:
    loop, e_axes, alpha_axes = axes
    if contact is None:
        loop.set(xlabel="indentation / largest", ylabel="force / largest")
    else:
        put_label(loop.xaxis, "indentation")
        put_label(loop.yaxis, "force")
    for picture in (e_axes, alpha_axes):
        if has_e:
            picture.set(xlabel="restitution asked for", xlim=(0, 1.02))
        else:
            picture.set_xscale("log")
            picture.set_xlabel(words_of("velocity"))
    e_axes.set(ylabel="restitution delivered", ylim=(0, 1.02))
    alpha_axes.set_ylabel(words_of("alpha"))
    if not alpha_axes.has_data():
        alpha_axes.set(xticks=[], yticks=[], xlabel="", ylabel="")
        words = "no damping factor:\nthe force is not\n$K δ^n (1 + α δ'/v_0)$"
        alpha_axes.text(0.5, 0.5, words, transform=alpha_axes.transAxes, ha="center", va="center")
    legend_above(loop)

"""A law, and air drag, from successive flights of a ball or from heights.

An interval that ends late makes the next one begin late. With trigger errors n, each of standard
deviation σ, and a scatter of each bounce of relative size s₀,

    ln T₂ - ln T₁ - ln e  has the error  (n₃ - n₂)/T₂ - (n₂ - n₁)/T₁ + s₀ ε,

so pairs that share triggers are correlated, up to two places apart. The divisors T are those that
the fit expects. Division by the reading would give errors of long readings less weight, and e would
be too small. Drops from one height h share its error n, which enters ln h₂ - ln h as -n/h.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Unpack

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .. import AbstractLaw, AbstractMethod, Contact, Drag, Fit, Huber, Positive, fit, restitution
from ..extend import (
    POSITIVE,
    STANDARD_GRAVITY,
    AbstractErrors,
    FitKeywords,
    Flight,
    Shown,
    column,
    for_each,
    method_of,
    not_shrinking,
    refit,
    require_choice,
    require_contact,
    require_law,
    takes,
    too_long,
    transforms_of,
    with_transforms,
)
from .pairs.outliers import THRESHOLD, deviations, mark, unusable
from .pairs.shared_noise import shared_noise, widening

Column = Float[np.ndarray, " n"]

_FEWEST, _FREE = 6, 4
"""Least pairs and degrees of freedom to separate two sizes of noise."""

_MOST = 2000
"""Largest number of pairs with a correlation matrix. More pairs have many trials: use `groups`."""

_SAME = 0.01
"""Largest change of the share of shared errors at convergence."""


class Shared(NamedTuple):
    """The errors that pairs share: their covariance (n, n) for errors of 1 s or 1 m, and notes.

    `shape` is None if no two pairs share one.
    """

    shape: Float[np.ndarray, "n n"] | None
    notes: tuple[str, ...] = ()


class ReadingErrors(AbstractErrors[Fit, dict[str, Any]]):
    """Errors of `first` and `second` readings that pairs share, and the scatter of the bounces.

    Nothing is estimated if no two pairs share an error, or from too few or too many pairs.
    """

    rounds = 6

    def __init__(self, first: Column, second: Column, kind: str):
        self.first: Column = first
        self.second: Column = second
        self._kind = _KINDS[kind]
        self._shared, self._noise, self._settled = Shared(None), None, False

    def estimate(self, found: Fit) -> dict[str, Any] | None:
        """Return the weights and the correlation of the pairs."""
        used = np.asarray(found.problem.factor) > 0
        enough = _FEWEST <= np.count_nonzero(used) <= _MOST and found.dof >= _FREE
        if self._settled or not enough or not found.converged:
            return None
        expected = np.where(used, np.exp(np.asarray(found.predict())), np.nan)
        self._shared = self._kind.shared(self.first, self.second, expected)
        if self._shared.shape is None:
            return None
        last, noise = self._noise, shared_noise(found, used, self._shared.shape)
        self._settled = last is not None and abs(noise.share - last.share) < _SAME
        self._noise = noise
        return {"weights": np.where(used, 1 / noise.variance, 0), "correlation": noise.correlation}

    def finish(self, found: Fit) -> Fit:
        """Return the fit with wider standard errors, and both sizes of errors in its notes."""
        noise, shared = self._noise, self._shared
        if noise is None or shared.shape is None or not found.converged:
            return found
        used = np.asarray(found.problem.factor) > 0
        wider = widening(found, used, shared.shape)
        # A robust fit has included its estimated scale in its weights.
        factor = np.asarray(found.problem.factor)[used]
        size = found.noise * float(np.median(factor**-2.0 / noise.variance[used]))
        both = (
            1e3 * math.sqrt(size * noise.share / noise.unit),
            100 * math.sqrt(size * (1 - noise.share)),
        )
        return dataclasses.replace(
            found,
            notes=(*found.notes, self._kind.errors.format(*both), *shared.notes),
            covariance=found.covariance * wider,
            _wider=np.full(len(found.names), wider),
        )


def by_triggers(first: Column, second: Column, expected: Column) -> Shared:
    """Return the errors that pairs of intervals share.

    Two pairs are successive if the second interval of one is the first of the next. The `expected`
    second intervals (NaN for a pair without weight) give the ratios within a run; the length of the
    run sets their scale.
    """
    follows = np.concatenate([[False], second[:-1] == first[1:]])
    if not follows.any():
        return Shared(None)
    good = np.isfinite(expected)
    chained = follows & good & np.concatenate([[False], good[:-1]])
    slopes = np.zeros((first.size, first.size + 2 * np.count_nonzero(~follows)))
    for rows in np.split(np.arange(first.size), np.flatnonzero(~chained)[1:]):
        read = np.append(first[rows], second[rows[-1]])
        ratio = np.where(good[rows], expected[rows], second[rows]) / first[rows]
        course = np.cumprod(np.append(1, ratio))
        before, after = np.stack([course[:-1], course[1:]]) * read.sum() / course.sum()
        at = rows + 2 * (np.cumsum(~follows)[rows] - 1)
        slopes[rows, at], slopes[rows, at + 1] = 1 / before, -1 / before - 1 / after
        slopes[rows, at + 2] = 1 / after
    alone = "standard errors exclude differences between trials, as there is only one trial"
    one = np.count_nonzero(~follows) == 1
    return Shared(slopes @ slopes.T, (alone,) if one else ())


def by_height(first: Column, second: Column, expected: Column) -> Shared:
    """Return the errors that drops share: all from one height share its error."""
    same = first[:, None] == first
    shape = None if np.array_equal(same, np.eye(first.size)) else same / np.outer(first, first)
    return Shared(shape)


_MOST_WRONG = 0.4
"""Largest usable fraction of wrong pairs.

A wrong trigger corrupts two or three pairs, and medians are robust up to half.
"""


class _ReadingKind(NamedTuple):
    """One kind of readings: the landing speed from the first, and the second from a launch speed.

    `launch` is the inverse of `second`. `shared` gives the errors that pairs share from both
    readings and the expected second ones, and `errors` their sizes in words, in ms or mm and in %.
    """

    landing: Callable[..., Any]
    launch: Callable[..., Any]
    second: Callable[..., Any]
    shared: Callable[[Column, Column, Column], Shared]
    errors: str
    shown: Mapping[str, Shown]


_KINDS = {
    "intervals": _ReadingKind(
        lambda t, g, b: Flight.landing_speed(Flight.launch_speed(t, g, b), g, b),
        *(Flight.launch_speed, Flight.duration, by_triggers),
        "errors of triggers {:.2g} ms, scatter of ln e {:.2g} %",
        {"x": Shown("time", "flight before"), "": Shown("time", "flight after", logarithm=True)},
    ),
    "heights": _ReadingKind(
        *(Flight.speed_after_drop, Flight.speed_to_reach, Flight.height_reached, by_height),
        "errors of drop heights {:.2g} mm, scatter of ln h {:.2g} %",
        {"x": Shown("height", "drop"), "": Shown("height", "rebound", logarithm=True)},
    ),
}


_OWN_ERRORS = "sigma", "weights", "groups", "correlation"
"""Arguments of `fit` by which the user describes the errors."""


class BounceModel(eqx.Module):
    """The parameters of a bounce fit: a law, a contact, and C_d, which is None in vacuum."""

    law: AbstractLaw
    contact: Contact
    drag_coefficient: Float[Array, ""] | float | None = None


class NextFlight(eqx.Module):
    """The logarithm of the flight time, or of the height, after an impact, from the one before.

    `slowing` is 1/v_t² at C_d = 1, in s²/m²; None in vacuum.
    """

    gravity: Float[Array, ""]
    slowing: Float[Array, ""] | None
    kind: str = eqx.field(static=True)
    method: AbstractMethod = eqx.field(converter=method_of)

    @property
    def shown(self) -> Mapping[str, Shown]:
        """The presentation of the readings before and after an impact."""
        return _KINDS[self.kind].shown

    def __call__(self, model: BounceModel, first: Float[Array, " n"]) -> Float[Array, " n"]:
        g, c_d = self.gravity, model.drag_coefficient
        b = None if self.slowing is None or c_d is None else self.slowing * c_d
        kind = _KINDS[self.kind]
        approach = kind.landing(first, g, b)
        launch = approach * restitution(model.law, model.contact, approach, method=self.method)
        return jnp.log(kind.second(launch, g, b))


@takes(FitKeywords)
def fit_bounces(
    law: AbstractLaw,
    contact: Contact,
    first: ArrayLike,
    second: ArrayLike,
    *,
    kind: str = "intervals",
    gravity: float = STANDARD_GRAVITY,
    drag: Drag | None = None,
    fixed: tuple[str, ...] = ("mass", "stiffness", "drag_coefficient"),
    method: str | AbstractMethod = "auto",
    **how: Unpack[FitKeywords],
) -> Fit:
    """Fit a law, and air drag, to successive flights of a ball on a heavy, level floor.

    A flight that lands at speed w is followed by one launched at e(w) w; in vacuum T₂ = e T₁ and h₂
    = e² h₁. The fit compares logarithms, ln T₂ or ln h₂: errors, `sigma` and residuals are
    relative.

    Arguments: `law` and `contact` are the start of the fit. `first` and `second`, both (points,),
    are, for `kind` "intervals", two successive times in s between impacts; for kind "heights", the
    heights in m of a drop from rest and of the rebound. `gravity` in m/s² (for a light ball reduced
    by buoyancy, g(1 - ρ_air/ρ_ball)). `drag` is quadratic: mass in kg and radius in m of the ball,
    coefficient C_d, and density of the air in kg/m³; None is vacuum. C_d is fitted from that start
    unless it is `fixed`. `method` as in `impact`. Other keywords go to `fit` (`sigma`,
    `loss=Huber()`, ...).

    `fixed`: names of numbers that are held. e(w) does not separate mass and stiffness from the
    parameters of the usual laws, so both are held by default. So is C_d, because only a wide range
    of speeds separates drag from a law whose damping grows with speed. The assumed law shifts C_d
    by far more than its standard error. `calibrate` holds C_d.

    Errors of `first` change the logarithm of `second` by nearly as much, so include them in
    `sigma`, the root of the sum of both squares. There is no bias while they are small compared
    with the range of the data.

    Successive intervals share a trigger, whose error enters them with opposite signs. Drops from
    one height share the error of that height. Unless `sigma`, `weights`, `groups` or `correlation`
    is given, restricted likelihood estimates the size of these errors and the scatter of the
    bounces, even for one trial. Pairs are successive if the second interval of one is the first of
    the next. The sizes are reported in `notes`. Standard errors account for the uncertainty of both
    sizes with few pairs. One trial does not determine the scatter between trials.

    With `loss=Huber()` pairs corrupted by a spurious or missed trigger are left out: those more
    than six robust standard deviations off the fit. They are found iteratively, starting from a
    trend without a law, and `notes` give their number. If they exceed 40 %, the recording cannot be
    used, and the fit is not converged.

    Returns a `Fit` whose params have `.law`, `.contact` and `.drag_coefficient` (None in vacuum),
    and whose `predict(first)` is ln T₂ or ln h₂. Raises ValueError for columns that do not match or
    are not positive, and arguments out of range.
    """
    require_choice("kind", kind, _KINDS)
    require_law(law)
    require_contact(contact)
    flight = Flight(gravity, drag)
    before = column(first, "first", POSITIVE)
    after = column(second, "second", POSITIVE, ("first", before))
    if kind == "intervals" and (why := too_long(before, flight.gravity)):
        raise ValueError(f"Argument `first` must be in s, but {why}.")
    pairs = np.stack([before, after], axis=1)
    if (factor := not_shrinking(list(pairs), 1.0 if kind == "intervals" else 2.0)) is not None:
        raise ValueError(
            f"Argument `second` must be shorter than `first`, as flights of a ball are after a "
            f"bounce, but is {factor:.3g} times as long (the median)."
        )
    start, slowing, transforms = BounceModel(law, contact), None, {}
    with jax.enable_x64(True):
        if drag is not None:
            start = BounceModel(law, contact, drag.coefficient)
            slowing = jnp.asarray(flight.terminal_speed**-2 / drag.coefficient)
            transforms["drag_coefficient"] = Positive()
        model = NextFlight(jnp.asarray(flight.gravity), slowing, kind, method)
    transforms |= transforms_of(start, fixed)
    given = with_transforms(transforms, how)

    def fitted(**errors: Any) -> Fit:
        return fit(model, np.log(after), start, x=before, **(given | errors))

    def again(last: Fit, errors: dict[str, Any]) -> Fit:
        return dataclasses.replace(fitted(**errors), notes=last.notes)

    if isinstance(given.get("loss"), Huber):
        velocity = flight.evaluate(_KINDS[kind].landing, before)[0]
        launch = flight.evaluate(_KINDS[kind].launch, after)[0]
        wrong = WrongPairs(before, after, velocity, launch / velocity, given)
        found = refit(wrong, fitted(**wrong.weights()), again)
    else:
        found = fitted()
    if any(given.get(name) is not None for name in _OWN_ERRORS):
        return found
    return refit(ReadingErrors(before, after, kind), found, again)


class WrongPairs(AbstractErrors[Fit, dict[str, Any]]):
    """Pairs off the fit by more than `THRESHOLD` robust standard deviations, which are left out.

    However small its weight, a wrong trigger biases the fit. The first fit leaves out what lies off
    a trend without a law, the next ones what lies off the previous fit. `options` are of `fit`.
    """

    rounds = 10

    def __init__(
        self, first: Column, second: Column, velocity: Column, e: Column, options: dict[str, Any]
    ):
        # Use the expected reading: a short reading would widen its own tolerance.
        usual = first * np.median(second / first)
        self._second, self._factor = np.log(second), first**-2.0 + usual**-2.0
        self._keep = ~mark(velocity, e, self._factor).flagged
        self._seen, self._options = {self._keep.tobytes()}, options

    def weights(self) -> dict[str, Any]:
        """Return the arguments of `fit` with zero weight for the pairs left out."""
        keep, sigma, weights = self._keep, *map(self._options.get, ("sigma", "weights"))
        if sigma is not None:
            return {"sigma": np.where(keep, for_each(sigma, "sigma", keep.size), np.inf)}
        if weights is not None:
            weights = for_each(weights, "weights", keep.size, zero=True)
        return {"weights": np.where(keep, 1.0 if weights is None else weights, 0.0)}

    def estimate(self, found: Fit) -> dict[str, Any] | None:
        """Return the weights without the pairs off this fit."""
        if not found.converged:
            return None
        residual = np.asarray(found.predict()) - self._second
        deviation, _ = deviations(residual, self._factor, self._keep)
        self._keep = np.abs(deviation) <= THRESHOLD
        if self._keep.tobytes() in self._seen:
            return None
        self._seen.add(self._keep.tobytes())
        return self.weights()

    def finish(self, found: Fit) -> Fit:
        """Return the fit with the number of pairs left out; not converged if they are too many."""
        wrong, count = int(np.count_nonzero(~self._keep)), self._keep.size
        if not wrong:
            return found
        pairs = f"{wrong} of {count} pairs lie more than {THRESHOLD:g} standard deviations off"
        if wrong > _MOST_WRONG * count:
            return unusable(found, f"{pairs}: the recording cannot be used")
        return dataclasses.replace(found, notes=(*found.notes, f"{pairs} and are left out"))

"""Contact and law from the record of one impact: force and indentation over time."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, Unpack

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..._calibration.pairs.columns import column, for_each, measured, with_transforms
from ..._calibration.problems.impacts import transforms_of
from ..._contact import Contact, require_contact
from ..._entry import POSITIVE, REAL, parameter, require_kind, require_number
from ..._fit import Fit, Fixed, fit, refit
from ..._fit.keywords import ColumnKeywords, takes
from ..._impact import trajectory
from ..._laws import AbstractLaw, force_of, require_law
from ..._text.units import Shown
from .filter_choice import without_a_needless_filter
from .instrument_errors import InstrumentErrors, require_filterable
from .low_pass import Course, LowPass
from .saturation import BeyondLimits, limits_of
from .start import level_in, near, touch_in, without_a_contact_elsewhere

_SAMPLES = 128
"""Samples of the motion for cubic interpolation: its error is below 1e-7 of the largest value."""


class RecordModel(eqx.Module):
    """The parameters of a record fit: law, contact, speed, touch, zero errors, and filters.

    `velocity` v0 in m/s, `start_time` in s, `force_offset` in N and `indentation_offset` in m. An
    offset is None if its column was not measured. `low_pass_force` and `low_pass_indentation` are
    None for a fast sensor.
    """

    law: AbstractLaw
    contact: Contact
    velocity: Float[Array, ""] = parameter("velocity", POSITIVE)
    start_time: Float[Array, ""] = parameter("start_time", REAL, "s")
    force_offset: Float[Array, ""] | None = eqx.field(default=None, metadata={"unit": "N"})
    indentation_offset: Float[Array, ""] | None = eqx.field(default=None, metadata={"unit": "m"})
    low_pass_force: LowPass | None = None
    low_pass_indentation: LowPass | None = None


class Recorded(eqx.Module):
    """Instrument readings at given times, each clipped to its limits."""

    low: Mapping[str, Array]
    high: Mapping[str, Array]
    shown: ClassVar[Mapping[str, Shown]] = {
        name: Shown(quantity)
        for name, quantity in (("x", "time"), ("force", "force"), ("indentation", "indentation"))
    }

    def __call__(self, model: RecordModel, time: Float[Array, " n"]) -> dict[str, Array]:
        path = trajectory(model.law, model.contact, model.velocity, samples=_SAMPLES)
        end, approach, leaving = path.time[-1], model.velocity, path.velocity[-1]
        since = time - model.start_time

        def depth(t: Array) -> tuple[Array, Array]:
            return _between(path.indentation, path.velocity, t, end)

        courses = {
            "force": Course(
                jnp.zeros_like(end),
                lambda t: force_of(model.law, *depth(t), model.contact, approach),
                end,
                (0.0, 0.0),
            ),
            # Before and after the contact the bodies fly: a gap is a negative indentation.
            "indentation": Course(
                approach,
                lambda t: depth(t)[0] - approach * t,
                end,
                (-approach * end, leaving - approach),
            ),
        }
        return {
            name: jnp.clip(
                _read(course, getattr(model, f"low_pass_{name}"), since)
                + getattr(model, f"{name}_offset"),
                self.low[name],
                self.high[name],
            )
            for name, course in courses.items()
            if getattr(model, f"{name}_offset") is not None
        }


def _read(course: Course, low_pass: LowPass | None, since: Array) -> Array:
    return course.read(since) if low_pass is None else low_pass.read(course, since, _SAMPLES - 1)


def _between(
    depth: Float[Array, " samples"],
    speed: Float[Array, " samples"],
    since: Float[Array, "..."],
    end: Float[Array, ""],
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Return indentation and rate at times after touch, by cubics between even samples."""
    width = end / (depth.size - 1)
    place = since / width
    left = jnp.clip(jnp.floor(jax.lax.stop_gradient(place)).astype(int), 0, depth.size - 2)
    t = place - left.astype(place.dtype)
    a, b = depth[left], depth[left + 1]
    p, q = speed[left] * width, speed[left + 1] * width
    c, d = 3 * (b - a) - 2 * p - q, p + q - 2 * (b - a)
    return a + t * (p + t * (c + t * d)), (p + t * (2 * c + 3 * t * d)) / width


@takes(ColumnKeywords, noise=None)
def fit_record(
    law: AbstractLaw,
    contact: Contact,
    time: ArrayLike,
    velocity: float,
    *,
    force: ArrayLike | None = None,
    indentation: ArrayLike | None = None,
    sigma_force: float | None = None,
    sigma_indentation: float | None = None,
    low_pass_force: LowPass | None = None,
    low_pass_indentation: LowPass | None = None,
    start_time: float | None = None,
    fixed: tuple[str, ...] = ("mass",),
    **how: Unpack[ColumnKeywords],
) -> Fit:
    """Fit a law and a contact to a sampled, noisy record of one impact: F(t), δ(t), or both.

    Arguments: `law`, `contact` and closing `velocity` in m/s are the start of the fit. `time` in s.
    The columns are `force` in N and `indentation` in m, at least one, all (samples,). Give a
    standard deviation for each column or for none; without them the fit estimates the noise of each
    column (`noise` is "by column" by default).

    The time of touch and the zero errors of the instruments are fitted too. `start_time` in s is
    the initial guess. By default it is the last reading before the peak below 5 % of it, and the
    zero of a force is the median of the quiet readings before. An initial stiffness is replaced if
    its contact would last over three times as long as the record shows, or under a third. It is
    also replaced in a second search if the first fails. Before and after the contact the force is
    zero and the indentation that of free flight.

    `low_pass_force` and `low_pass_indentation` model a sensor that is not much faster than the
    contact. The cut-off is fitted from the given value unless "low_pass_force" is in `fixed`. A
    fitted filter that does not lower AICc is left out, and `notes` bound its cut-off and delay.
    `fixed` names the parameters that are held, the mass by default (add "velocity" if it was
    measured). Other keywords go to `fit`, such as `loss=Huber()`.

    Instrument noise is estimated with the fit and reported in `notes`. Readings at a limit count as
    at least that value. A low-pass filter correlates noise. Steps q above a third of the scatter
    have the rounding errors of a random zero, with variance q²/12. Readings share them while the
    signal rests. Standard errors and intervals include this correlation; weights do not.

    A force alone determines the mass only if the speed is known. An indentation alone determines
    only K/m. Hold what is not identifiable, or see `unidentified`.

    Returns a `Fit` whose params have `.law`, `.contact`, `.velocity`, `.start_time` and the
    offsets. It is not converged if its contact misses that of the record. Raises ValueError for
    columns that do not match.
    """
    require_law(law)
    require_contact(contact)
    velocity = require_number("velocity", velocity, POSITIVE)
    moments = column(time, "time", REAL)
    columns = {
        "force": (force, sigma_force, REAL),
        "indentation": (indentation, sigma_indentation, REAL),
    }
    table = _table_of(columns, moments, how.pop("weights", None))
    reading = next(iter(table["data"].values()))
    filters = {"force": low_pass_force, "indentation": low_pass_indentation}
    _check_filters(filters, table["data"])
    level = level_in(reading) if force is not None else 0.0
    guess = touch_in(moments, reading - level) if start_time is None else start_time
    start_time = require_number("start_time", guess)
    numbers: Any = velocity, start_time
    zeros = {"force": level, "indentation": 0.0}
    offsets = (jnp.asarray(zeros[name]) if name in table["data"] else None for name in columns)
    start = RecordModel(law, contact, *numbers, *offsets, *filters.values())
    transforms = transforms_of(start, fixed)
    options = with_transforms(transforms, how)
    if options.get("noise") is None:
        options["noise"] = "common" if "sigma" in table else "by column"
    # The zero before and after a contact is not a limit of a force.
    limits = {
        name: limits_of(readings, two_sided=name == "indentation")
        for name, readings in table["data"].items()
    }
    with jax.enable_x64(True):
        instruments = Recorded(
            *({name: jnp.asarray(one[k]) for name, one in limits.items()} for k in range(2))
        )
    sizes = {name: values for name, values in table.items() if name != "data"}

    def fitted(start: RecordModel, errors: dict[str, Any], **more: Any) -> Fit:
        return fit(instruments, start=start, x=moments, **(table | options | errors | more))

    def errors_of(start: RecordModel) -> dict[str, Any]:
        # Readings behind a filter get a correlation later: starting with one keeps one program.
        behind = any(getattr(start, f"low_pass_{name}") is not None for name in table["data"])
        return {"correlation": np.eye(moments.size * len(table["data"]))} if behind else {}

    def search(start: RecordModel) -> Fit:
        errors = errors_of(start)

        def again(last: Fit, estimated: dict[str, Any]) -> Fit:
            errors.update(estimated)
            return dataclasses.replace(fitted(last.params, errors), notes=last.notes)

        found = refit(BeyondLimits(limits, sizes), fitted(start, errors), again)
        found = refit(InstrumentErrors(table | errors, moments, limits), found, again)
        return without_a_contact_elsewhere(found, table["data"])

    signal = reading - level
    found = search(near(start, moments, signal, transforms))
    # A second start has the duration of the contact in the record.
    second = near(start, moments, signal, transforms, far=1.0)
    if not found.converged and second is not start:
        found = max(found, search(second), key=lambda one: one.converged)
    cutoffs = {f"low_pass_{name}.cutoff": name for name, one in filters.items() if one is not None}
    own = options["transforms"]

    def held(start: RecordModel) -> Fit:
        return fitted(start, errors_of(start), transforms=own | dict.fromkeys(cutoffs, Fixed()))

    for cutoff, name in cutoffs.items():
        if not own.keys() & {cutoff, f"low_pass_{name}"}:
            found = without_a_needless_filter(found, name, moments, search, held)
    return found


def _table_of(
    columns: Mapping[str, Any], time: Float[np.ndarray, " n"], weights: Mapping[str, Any] | None
) -> dict[str, Any]:
    """Return the readings as arguments of `fit`, with given `weights` by column if there are."""
    table = measured(columns, ("time", time), weight=lambda c: np.abs(c).max() ** -2.0)
    for name, readings in table["data"].items():
        if np.ptp(readings) == 0:
            raise ValueError(f"Argument `{name}` must vary, but is {readings[0]:g} everywhere.")
    if weights is None:
        return table
    own = {n: for_each(weights[n], "weights", time.size, zero=True) for n in table["data"]}
    return {"data": table["data"], "weights": own}


def _check_filters(filters: Mapping[str, Any], data: Mapping[str, Any]) -> None:
    """Raise ValueError for an invalid filter, and for one of a column that is not there."""
    for name, one in filters.items():
        if one is not None:
            require_kind(f"low_pass_{name}", one, LowPass, "a `LowPass` or None")
            require_filterable(name, data.get(name))

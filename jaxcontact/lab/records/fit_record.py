"""Contact and law from the record of one impact: force and indentation over time."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Container, Mapping
from typing import Any, ClassVar, TypeVar, Unpack

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ... import AbstractHuntCrossley, AbstractLaw, Contact, Fit, Fixed, fit, trajectory
from ...extend import (
    POSITIVE,
    REAL,
    ColumnKeywords,
    Shown,
    column,
    for_each,
    force_of,
    measured,
    parameter,
    refit,
    require_contact,
    require_kind,
    require_law,
    require_number,
    takes,
    transforms_of,
    with_transforms,
)
from ..pairs.outliers import unusable
from .instrument_errors import InstrumentErrors, require_filterable
from .low_pass import BeyondLimits, Course, LowPass, limits_of

_SAMPLES = 128
"""Samples of the motion for cubic interpolation: its error is below 1e-7 of the largest value."""

_EXCLUDED = 3.84
"""Increase of the deviance at which a cut-off is excluded: χ² of one parameter at 95 %."""

_OCTAVE, _PARTS = 2.0, 4
"""Factor between cut-offs that are tried, from the highest, and steps within the last one."""

_LEAST_TURNS = 0.1
"""Lowest cut-off that is tried, times the length of the record."""

Column = Float[np.ndarray, " n"]
Model = TypeVar("Model", bound=Any)

_TOUCHED = 0.05
"""Fraction of the largest reading above which contact is assumed, as a start for the touch."""

_QUIET = 5
"""Least number of readings for the level without contact."""

_HALF = 0.6
"""Fraction of a contact during which force or indentation exceeds half of its maximum.

It ranges from .57 for a Hertz force to .67 for the sine of a linear spring.
"""

_FAR = 3.0
"""Factor beyond which a duration is no usable start: the two contacts would hardly overlap."""

_DAMPING = 0.01, 3.0
"""Range of damping factors α that show in a record and leave a measurable rebound."""

_SEEN = 0.5
"""Least fraction of the non-noise scatter of a column that a fit must describe.

Contacts that lie beside the one of the record describe almost nothing of it.
"""


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


def criterion(found: Fit) -> float:
    """Return the AICc of a fit, with the determinant of the correlation of its noise."""
    whitener = found.problem.whitener
    volume = 0.0 if whitener is None else -2 * float(np.sum(np.log(np.diag(whitener))))
    return found.criteria[1] + volume


def without_a_needless_filter(
    found: Fit,
    column: str,
    time: np.ndarray,
    search: Callable[[Any], Fit],
    held: Callable[[Any], Fit],
) -> Fit:
    """Return the fit, or the one without the filter of a column if that has the lower AICc.

    The note then states the lowest cut-off f_c that the record allows (95 %, by the likelihood with
    all other numbers fitted again), and the largest delay. `search` fits from given parameters, and
    `held` fits with the cut-offs of filters held and independent noise.
    """
    name = f"low_pass_{column}"
    plain = search(dataclasses.replace(found.params, **{name: None}))
    if not plain.converged or (found.converged and criterion(found) < criterion(plain)):
        return found
    low_pass, most = getattr(found.params, name), criterion(plain) + _EXCLUDED
    delay, last = low_pass.delay * low_pass.cutoff, plain.params
    lowest = (time.size - 1) / float(time[-1] - time[0]) / 2
    end = _LEAST_TURNS / float(time[-1] - time[0])
    for factor in (_OCTAVE, _OCTAVE ** (1 / _PARTS)):
        while lowest > end:
            cutoff = lowest / factor
            filtered = eqx.tree_at(lambda f: f.cutoff, low_pass, jnp.asarray(cutoff))
            # The filter delays: the touch is earlier by as much.
            touch = plain.params.start_time - delay / cutoff
            tried = held(dataclasses.replace(last, start_time=touch, **{name: filtered}))
            if not criterion(tried) < most:
                break
            lowest, last = cutoff, tried.params
    note = (
        f"a low-pass filter of {column} does not lower AICc and is left out: its cut-off is at "
        f"least {lowest:.3g} Hz, its delay at most {float(delay) / lowest:.2g} s (95 %)"
    )
    return dataclasses.replace(plain, notes=(*plain.notes, note))


def level_in(reading: Column) -> float:
    """Return the level without contact: the median of quiet readings before it, or after it."""
    top, half = int(np.argmax(reading)), (reading.max() + np.median(reading)) / 2
    width, below = int(np.count_nonzero(reading > half)), np.flatnonzero(reading <= half)
    # From touch to half of the peak a force takes less time than it stays above that.
    before = reading[: max(int(below[below < top].max(initial=0)) - width, 0)]
    after = reading[int(below[below > top].min(initial=reading.size)) + 2 * width :]
    quiet = next((one for one in (before, after) if one.size >= _QUIET), reading.min())
    return float(np.median(quiet))


def touch_in(time: Column, reading: Column) -> float:
    """Return the approximate time in s, back from the peak, at which a reading begins to rise."""
    top = int(np.argmax(reading))
    below = np.flatnonzero(reading[: top + 1] <= _TOUCHED * reading[top])
    return float(time[below[-1] if below.size else 0])


def duration_ratio(n: float) -> float:
    """Return v T over the largest indentation of a contact without damping.

    `T = 2√π/(n+1) Γ(1/(n+1))/Γ(1/(n+1) + 1/2) ((n+1) m/(2 K v^(n-1)))^(1/(n+1))`.
    """
    part = 1 / (n + 1)
    return 2 * math.sqrt(math.pi) * part * math.gamma(part) / math.gamma(part + 0.5)


def stiffness_of(mass: float, n: float, speed: float, duration: float) -> float:
    """Return the stiffness in N/m^n with this duration in s, without damping."""
    ratio = duration_ratio(n)
    return mass / (2 * (1 / (n + 1)) * speed ** (n - 1)) * (ratio / duration) ** (n + 1)


def near(
    start: Model, time: Column, reading: Column, held: Container[str], far: float = _FAR
) -> Model:
    """Return the start with a stiffness that gives about the contact duration of the record.

    Numbers that are `held`, by their full names, stay, and so does a stiffness whose contact is not
    longer or shorter by a factor of `far`. `reading` is without the level before the contact.
    """
    contact, speed = start.contact, float(start.velocity)
    mass, stiffness, n = (float(getattr(contact, f)) for f in ("mass", "stiffness", "exponent"))
    width = np.sum(np.gradient(time)[reading > reading.max() / 2]) if time.size > 1 else 0.0
    duration = float(width) / _HALF
    if "contact.stiffness" in held or not (reading.max() > 0 and 0 < duration < math.inf):
        return start
    better = stiffness_of(mass, n, speed, duration)
    if abs(math.log(better / stiffness)) <= (n + 1) * math.log(far):
        return start
    start = eqx.tree_at(lambda s: s.contact.stiffness, start, jnp.asarray(better))
    law, c = start.law, getattr(start.law, "c", None)
    if isinstance(law, AbstractHuntCrossley) and c is not None and "law.c" not in held:
        # A dimensional damping factor means a different damping at a different stiffness.
        alpha = float(law.damping_factor(start.contact, speed))
        if alpha > 0:
            c = c * (min(max(alpha, _DAMPING[0]), _DAMPING[1]) / alpha)
            start = eqx.tree_at(lambda s: s.law.c, start, c)
    return start


def without_a_contact_elsewhere(found: Fit, data: dict[str, Column]) -> Fit:
    """Return the fit, not converged if it misses the contact in a column.

    Differences of neighbouring readings measure the noise; scatter beyond it is the contact. The
    fit must leave less than half of that scatter.
    """
    at = 0
    for name, values in data.items():
        rows = slice(at, at + values.size)
        at += values.size
        noise = float(np.mean(np.square(np.diff(values)))) / 2 if values.size > 1 else math.inf
        signal = float(np.var(values)) - noise
        missed = float(np.nanmean(np.square(found.residuals[rows]))) - noise
        if found.converged and signal > 0 and missed > (1 - _SEEN) * signal:
            part = 100 * max(1 - missed / signal, 0)
            reason = (
                f"its contact misses that of the record: it describes {part:.0f} % of the {name}; "
                "start from another stiffness, speed or `start_time`"
            )
            return unusable(found, reason)
    return found

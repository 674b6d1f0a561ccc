"""Design of the next readings: for parameters, or to separate two laws; and its optimal rows."""

from __future__ import annotations

import collections
import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from .. import AbstractLaw, AbstractMethod, Contact, Fit, fit
from ..extend import (
    POSITIVE,
    AbstractTransform,
    ImpactModel,
    Outcome,
    Space,
    column,
    quick,
    refusal,
    rendered,
    require_choice,
    require_contact,
    require_count,
    require_law,
    require_number,
    space_of,
    text_table,
    transforms_of,
    wrapped,
)

_SETTLED = 1e-3
"""Relative decrease of the largest difference of two laws at convergence."""

_ROUNDS = 50
_REACH = 1.0
"""Step limit of one linear programme, in logarithms or logits."""

_SAME = 1e-6
"""Difference of two laws in units of the noise below which they are the same."""


def minimax(
    off: Float[np.ndarray, " n"], slopes: Float[np.ndarray, "n k"], reach: float | None = None
) -> tuple[Float[np.ndarray, " k"], float, Float[np.ndarray, " n"]]:
    """Return the change of the least largest |off + slopes @ change|, that, and multipliers."""
    # Imported here, since `linprog` loads half of SciPy.
    from scipy.optimize import linprog

    rows, k = np.concatenate([slopes, -slopes]), slopes.shape[1]
    limits = [(None if reach is None else -reach, reach)] * k + [(0, None)]
    upper = np.column_stack([rows, -np.ones(len(rows))])
    cost = np.append(np.zeros(k), 1.0)
    made = linprog(cost, upper, np.concatenate([-off, off]), bounds=limits)
    return made.x[:-1], float(made.fun), -made.ineqlin.marginals.reshape(2, -1).sum(axis=0)


class Rival(NamedTuple):
    """The `readings` (n,) of a model at `speeds`, with noise `size`, and the other law."""

    model: Outcome
    other: ImpactModel
    speeds: np.ndarray
    readings: np.ndarray
    size: np.ndarray
    transforms: dict[str, AbstractTransform]

    def fit(self, **how: np.ndarray) -> Fit:
        """Fit the other law to the readings, with their `sigma` or `weights`."""
        fields = self.model.fields

        def by_field(values: np.ndarray) -> dict[str, np.ndarray]:
            return dict(zip(fields, values.reshape(len(fields), -1), strict=True))

        options: Any = {name: by_field(values) for name, values in how.items()}
        options |= {"x": self.speeds, "transforms": self.transforms, "throw": False}
        return fit(self.model, by_field(self.readings), self.other, **options)

    def differences(self, space: Space, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the other law's slopes and its differences, in units of noise."""
        slopes, own = readings_of(self.model, space, theta, self.speeds)
        return slopes / self.size[:, None], (own - self.readings) / self.size

    def shares(self) -> np.ndarray:
        """Return the share of each candidate in the plan that separates the other law.

        The parameters of the other law minimise its largest difference. The multipliers of the
        candidates with that difference are the best plan; under it, these parameters are also those
        of least squares (Atkinson & Fedorov 1975). Solved by successive linear programmes.
        """
        found = self.fit(sigma=self.size)
        if not found.converged:
            raise ValueError(
                "Argument `goal` must be a law that can be fitted to the other, but its fit did "
                f"not converge: {found.reason}."
            )
        space, theta, reach = found.problem.space, found._theta, _REACH
        slopes, off = self.differences(space, theta)
        share = np.full(len(off), 1 / len(off))
        for _ in range(_ROUNDS):
            largest = np.max(np.abs(off))
            if largest < _SAME:
                return share
            change, bound, share = minimax(off, slopes, reach)
            if largest - bound <= _SETTLED * largest:
                break
            there = self.differences(space, theta + change)
            if np.max(np.abs(there[1])) < largest:
                theta, (slopes, off) = theta + change, there
            else:
                reach = np.max(np.abs(change)) / 4
        return share / share.sum()

    def distance(self, counts: np.ndarray) -> float:
        """Return λ of a plan, with the other law fitted to its readings."""
        found = self.fit(weights=counts / self.size**2)
        distance = 2 * found.loss if found.converged else math.nan
        return 0.0 if distance < counts.sum() * _SAME**2 else distance


def readings_of(
    model: Outcome, space: Space, theta: np.ndarray, speeds: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return d reading/d(free coordinate) of all candidates, and the readings."""
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        slopes, readings = _compiled(model, space, *jax.device_put((theta, speeds)))
    return np.asarray(slopes), np.asarray(readings)


@quick
def _compiled(
    model: Outcome, space: Space, theta: Float[Array, " k"], speeds: Float[Array, " m"]
) -> tuple[Float[Array, "qm k"], Float[Array, " qm"]]:

    def read(theta: Float[Array, " k"]) -> tuple[Array, Array]:
        found = model(space.tree_of(space.values(theta)), speeds)
        readings = jnp.concatenate([found[name] for name in model.fields])
        return readings, readings

    return jax.jacfwd(read, has_aux=True)(theta)


QUANTITIES = "e", "duration", "max_force"

ALL = "all"

_RARE = 1e-2
"""Share of a plan below which a reading is left to its neighbours, relative to the largest."""


@dataclasses.dataclass(frozen=True)
class Design:
    """A plan of n readings: at the closing speeds `velocity` (n,) in m/s, each of one `quantity`.

    `standard_errors` are those of the parameters after these readings, and `even` those after as
    many readings spread evenly over the candidates. For two laws these are None, and
    `noncentrality` is the least λ = Σ ((difference of the laws)/σ)² over the parameters of the
    second. `readable` names the quantities that could be read.
    """

    velocity: np.ndarray
    quantity: tuple[str, ...]
    standard_errors: dict[str, float] | None = None
    even: dict[str, float] | None = None
    noncentrality: float | None = None
    readable: tuple[str, ...] = QUANTITIES

    def readings_for(self, noncentrality: float = 40.0) -> int:
        """Return how many readings like these separate the laws.

        With λ = 40 the wrong law is detected in all but one of ten thousand data sets (χ² at 5 %
        with one degree of freedom). Raises ValueError for a plan without a second law, for laws
        that do not differ, and for a λ that is not positive.
        """
        wanted = require_number("noncentrality", noncentrality, POSITIVE)
        if self.noncentrality is None:
            raise ValueError("`readings_for` needs a design made with a second law as `goal`.")
        if not self.noncentrality > 0:
            raise ValueError(f"No number of readings separates the laws: {self.meaning}")
        places = {*zip(self.quantity, self.velocity.tolist(), strict=True)}
        # Each place of the plan is needed, and more of them than the other law has parameters.
        return max(len(places), math.ceil(len(self.velocity) * wanted / self.noncentrality))

    @property
    def meaning(self) -> str:
        """The meaning of λ in words, and what to do; "" for a plan for one law."""
        if self.noncentrality is None:
            return ""
        if math.isnan(self.noncentrality):
            return "λ is unknown: the fit of the other law to this plan did not converge"
        if self.noncentrality > 0:
            return f"{self.readings_for()} such readings distinguish the laws (λ = 40)"
        left = " or ".join(name for name in QUANTITIES if name not in self.readable)
        more = f"read {left} as well (give its sigma), or " if left else ""
        return (
            "the second law gives the same readings with other parameters. To distinguish the "
            f"laws, {more}hold a known number of the contact (its stiffness). Laws K δⁿ (1 + α "
            "δ'/v0) of one parameter e differ only in their definition of e, so no reading "
            "distinguishes them: use either"
        )

    def __repr__(self) -> str:
        places = collections.Counter(zip(self.quantity, self.velocity.tolist(), strict=True))
        rows = [
            (quantity, f"{speed:.4g}", str(times))
            for (quantity, speed), times in sorted(places.items())
        ]
        lines = [f"Design: {len(self.velocity)} readings"]
        lines += text_table(rows, header=("quantity", "v (m/s)", "times"), align="<>>", indent=2)
        if self.standard_errors is not None and self.even is not None:
            lines += [
                f"  {name}  ± {error:.3g} expected; spread evenly ± {self.even[name]:.3g}"
                for name, error in self.standard_errors.items()
            ]
        if self.noncentrality is not None:
            lines.append(f"  λ = {self.noncentrality:.3g} between the two laws")
            lines += wrapped("", self.meaning, indent=2)
        return "\n".join(lines)


def design(
    law: AbstractLaw,
    contact: Contact,
    *,
    sigma: Mapping[str, float],
    candidates: ArrayLike,
    readings: int = 8,
    goal: str | AbstractLaw = ALL,
    fixed: tuple[str, ...] = ("mass",),
    method: str | AbstractMethod = "auto",
) -> Design:
    """Design the readings that best determine the parameters of a law and a contact.

    A reading of a quantity y at a closing speed v has the sensitivity x = (dy/dp)/σ to the
    parameters, and several leave the covariance (Σ x xᵀ)⁻¹. The design minimises its determinant
    (D-optimal), or one element of its diagonal. With a second law as `goal` it maximises λ = min Σ
    ((y - y₂)/σ)² over the parameters of the second law (T-optimal), to separate the laws.

    Arguments: `law` and `contact`, the best known values: the plan is optimal there, and good near
    it. `sigma`: the standard deviation of a reading, by quantity: "e", and "duration" and
    "max_force" relative to their size; only the quantities in it are read. `candidates` (m,):
    possible closing speeds in m/s. `readings`: their number; each is of one quantity at one speed,
    and may repeat. `goal`: "all" parameters, the name of one ("law.c", "contact.stiffness"), or the
    other law. `fixed`: names of known numbers, as in `fit_impacts`; e alone determines neither K
    nor m. `method` as in `impact`.

    Returns a `Design`. Computes in double precision regardless of the JAX setting. Raises
    ValueError for arguments out of range, candidates that do not determine the parameters, fewer
    readings than parameters, and a second law whose fit does not converge.

    Source: Atkinson, Donev & Tobias (2007), Optimum Experimental Designs, with SAS; Atkinson &
    Fedorov (1975), doi 10.1093/biomet/62.1.57.
    """
    require_law(law)
    require_contact(contact)
    errors = _sigma(sigma)
    speeds = column(candidates, "candidates", POSITIVE)
    count = require_count("readings", readings, 1)
    with jax.enable_x64(True):
        model, start = Outcome(method, tuple(errors)), ImpactModel(law, contact)
        other = ImpactModel(goal, contact) if isinstance(goal, AbstractLaw) else None
        space, theta = space_of(start, transforms_of(start, fixed, other))
    slopes, expected = readings_of(model, space, theta, speeds)
    if not (np.isfinite(slopes).all() and np.isfinite(expected).all()):
        raise ValueError("Argument `candidates` must be speeds whose impacts can be solved.")
    quantity, velocity = np.repeat(list(errors), speeds.size), np.tile(speeds, len(errors))
    size = np.repeat(list(errors.values()), speeds.size)
    if other is not None:
        rival = Rival(model, other, speeds, expected, size, transforms_of(other, fixed, start))
        share = rival.shares()
        counts = shared_out(np.where(share > _RARE * share.max(), share, 0), count)
        rows = np.repeat(np.arange(size.size), counts)
        told = {"noncentrality": rival.distance(counts), "readable": tuple(errors)}
        return Design(velocity[rows], tuple(quantity[rows].tolist()), **told)
    choices = [ALL, *space.names]
    require_choice("goal", goal, choices)
    scaled = slopes / size[:, None]
    _check(scaled, space, count, sigma)
    criterion = by_volume if goal == ALL else by_parameter(space.names.index(goal))
    rows = best_rows(scaled, count, criterion)
    even = np.linspace(0, size.size - 1, max(count, size.size)).round().astype(int)
    with jax.enable_x64(True):
        stretch = space.stretch(np.asarray(space.values(jnp.asarray(theta))))
    of_best = _errors(scaled[rows], len(rows), count) * stretch
    of_even = _errors(scaled[even], len(even), count) * stretch
    return Design(
        velocity[rows],
        tuple(quantity[rows].tolist()),
        dict(zip(space.names, of_best.tolist(), strict=True)),
        dict(zip(space.names, of_even.tolist(), strict=True)),
    )


def _sigma(given: Any) -> dict[str, float]:
    if not isinstance(given, Mapping) or not given or not set(given) <= set(QUANTITIES):
        must = f"give standard deviations to some of {', '.join(QUANTITIES)}"
        raise refusal("sigma", must, given)
    there = [name for name in QUANTITIES if name in given]
    return {name: require_number(f'sigma["{name}"]', given[name], POSITIVE) for name in there}


def _check(scaled: np.ndarray, space: Space, count: int, sigma: Any) -> None:
    k = scaled.shape[1]
    if count < k:
        raise ValueError(
            f"Argument `readings` must be at least the number of parameters, {k} "
            f"({', '.join(space.names)}), but is {count}."
        )
    length = np.linalg.norm(scaled, axis=0)
    lost = length == 0
    if not lost.any():
        _, s, vt = np.linalg.svd(scaled / length, full_matrices=False)
        if len(s) < k or s[-1] <= 1e-7 * s[0]:
            lost = np.abs(vt[-1]) > 1e-3
    if lost.any():
        names = ", ".join(name for name, one in zip(space.names, lost, strict=True) if one)
        raise ValueError(
            "Argument `sigma` must give quantities that determine all parameters at the "
            f"`candidates`, but {rendered(sigma)} does not determine {names}; read another "
            "quantity, or hold a known number with `fixed`."
        )


def _errors(rows: np.ndarray, of: int, count: int) -> np.ndarray:
    """Return the standard errors of `count` readings distributed like `of` ones."""
    inverse = np.linalg.inv(rows.T @ rows * (count / of))
    return np.sqrt(np.diag(inverse))


_STARTS = 8
_GAIN = 1e-9
"""Least improvement of a criterion."""

_FLOOR = 1e-12
"""Regularisation for too few readings, relative to the information of all candidates."""

Criterion = Callable[[Float[np.ndarray, "m k k"]], Float[np.ndarray, " m"]]
"""A function of information matrices that is minimised."""


def by_volume(information: Float[np.ndarray, "m k k"]) -> Float[np.ndarray, " m"]:
    """Return -ln det M/k: the mean logarithm of the squared axes of the error ellipsoid."""
    return -np.linalg.slogdet(information)[1] / information.shape[-1]


def by_parameter(index: int) -> Criterion:
    """Return the criterion ln (M⁻¹)_ii, of the squared standard error of one parameter."""
    return lambda information: np.log(np.linalg.inv(information)[:, index, index])


def best_rows(
    slopes: Float[np.ndarray, "m k"], count: int, criterion: Criterion
) -> Int[np.ndarray, " count"]:
    """Return the `count` rows of `slopes`, which may repeat, whose Σ x xᵀ has the least criterion.

    Exchanges rows for better ones while possible, from several starts (Fedorov 1972, Theory of
    Optimal Experiments; Nguyen & Miller 1992, doi 10.1016/0167-9473(92)90064-M).
    """
    scale = np.linalg.norm(slopes, axis=0)
    rows = slopes / scale
    products = rows[:, :, None] * rows[:, None, :]
    floor = _FLOOR * np.eye(rows.shape[1])
    random = np.random.default_rng(0)
    best, lowest = np.zeros(count, int), np.inf
    for _ in range(_STARTS):
        chosen = random.integers(len(rows), size=count)
        value = np.inf
        while True:
            before = value
            for place in range(count):
                others = products[np.delete(chosen, place)].sum(axis=0) + floor
                values = criterion(others + products)
                better = int(np.argmin(values))
                if values[better] < value - _GAIN:
                    chosen[place], value = better, float(values[better])
            if not value < before - _GAIN:
                break
        if value < lowest - _GAIN:
            best, lowest = np.sort(chosen), value
    return best


def shared_out(weights: Float[np.ndarray, " m"], count: int) -> Int[np.ndarray, " m"]:
    """Return integers that add up to `count`, nearly in proportion to weights.

    The efficient rounding of Pukelsheim & Rieder (1992), doi 10.1093/biomet/79.4.763.
    """
    support = np.flatnonzero(weights)
    # With more places than readings, use the heaviest.
    support = support[np.argsort(-weights[support], kind="stable")[:count]]
    share = weights[support] / weights[support].sum()
    whole = np.ceil((count - len(support) / 2) * share).astype(int)
    while whole.sum() < count:
        whole[np.argmin(whole / share)] += 1
    while whole.sum() > count:
        whole[np.argmax((whole - 1) / share)] -= 1
    result = np.zeros(len(weights), int)
    result[support] = whole
    return result

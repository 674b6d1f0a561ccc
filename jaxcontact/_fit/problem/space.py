"""The fitted numbers of a pytree: their names, bounds and free coordinates."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import DictKey, FlattenedIndexKey, GetAttrKey, SequenceKey
from jaxtyping import Array, Float

from ..._entry import Range, as_numbers, refusal, rendered, require_number
from ..._text.units import meaning
from ..._text.words import first_few


class AbstractTransform:
    """The range of a fitted parameter: `Free`, `Positive`, `Between` or `Fixed`.

    Its class converts between a value and the free number that is fitted; it selects code, and the
    bounds `low` and `high` are data. `label` precedes the name of a parameter in this coordinate.
    `has_unit`: a change of 1 means the same everywhere, as for a logarithm or a logit. The
    functions take (value, low, high), or (free number, low, high). `_slope` is dvalue/dfree at a
    value, and `_log_slope` its logarithm at a free number.
    """

    low: float
    high: float
    label: ClassVar[str]
    has_unit: ClassVar[bool] = True
    bounded_above: ClassVar[bool] = False
    _to_free: ClassVar[Callable[[float, float, float], float]]
    _to_value: ClassVar[Callable[[jax.Array, jax.Array, jax.Array], jax.Array]]
    _slope: ClassVar[Callable[[Any, float, float], Any]]
    _log_slope: ClassVar[Callable[[jax.Array, jax.Array, jax.Array], jax.Array]]

    @property
    def bounds(self) -> tuple[float, float]:
        """The ends of the range."""
        return self.low, self.high


@dataclasses.dataclass(frozen=True)
class Free(AbstractTransform):
    """Any real number, fitted directly."""

    low: float = dataclasses.field(default=-math.inf, init=False, repr=False)
    high: float = dataclasses.field(default=math.inf, init=False, repr=False)
    label: ClassVar[str] = ""
    has_unit: ClassVar[bool] = False
    _to_free = staticmethod(lambda value, low, high: value)
    _to_value = staticmethod(lambda free, low, high: free)
    _slope = staticmethod(lambda value, low, high: np.ones_like(value))
    _log_slope = staticmethod(lambda free, low, high: jnp.zeros_like(free))


@dataclasses.dataclass(frozen=True)
class Positive(AbstractTransform):
    """A number above 0; its logarithm is fitted."""

    low: float = dataclasses.field(default=0.0, init=False, repr=False)
    high: float = dataclasses.field(default=math.inf, init=False, repr=False)
    label: ClassVar[str] = "ln "
    _to_free = staticmethod(lambda value, low, high: math.log(value))
    _to_value = staticmethod(lambda free, low, high: jnp.exp(free))
    _slope = staticmethod(lambda value, low, high: value)
    _log_slope = staticmethod(lambda free, low, high: free)


@dataclasses.dataclass(frozen=True)
class Between(AbstractTransform):
    """A number between `low` and `high`; the logit of its relative position is fitted.

    The ends are approached but never reached; a fit that runs there reports it. Raises ValueError
    unless low < high are finite.
    """

    low: float
    high: float
    label: ClassVar[str] = "logit "
    bounded_above: ClassVar[bool] = True
    _to_free = staticmethod(lambda value, low, high: math.log((value - low) / (high - value)))
    _to_value = staticmethod(lambda free, low, high: low + (high - low) * jax.nn.sigmoid(free))
    _slope = staticmethod(lambda value, low, high: (value - low) * (high - value) / (high - low))
    _log_slope = staticmethod(
        lambda free, low, high: (
            jnp.log(high - low) + jax.nn.log_sigmoid(free) + jax.nn.log_sigmoid(-free)
        )
    )

    def __post_init__(self) -> None:
        for name in ("low", "high"):
            object.__setattr__(self, name, require_number(name, getattr(self, name)))
        if not self.low < self.high:
            raise ValueError(
                f"Argument `high` must be above `low`, but they are {self.high!r} and {self.low!r}."
            )


@dataclasses.dataclass(frozen=True)
class Fixed(AbstractTransform):
    """A number that is not fitted."""


class Space(eqx.Module):
    """Free coordinates θ (k,) of the fitted numbers in a pytree of parameters.

    `coordinates`, one for each number, select code. `units` are "" if unknown. Bounds and the other
    leaves are data. A number stays at `held`, whatever its coordinate, unless that is NaN.
    """

    low: Float[Array, " k"]
    high: Float[Array, " k"]
    held: Float[Array, " k"]
    others: list[Any]
    structure: Any = eqx.field(static=True)
    coordinates: tuple[type[AbstractTransform], ...] = eqx.field(static=True)
    shapes: tuple[tuple[int, ...] | None, ...] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)

    def values(self, theta: Float[Array, " k"]) -> Float[Array, " k"]:
        """Return the fitted numbers themselves, in the order of their names."""
        columns = zip(self.coordinates, theta, self.low, self.high, strict=True)
        moved = jnp.stack([coordinate._to_value(*column) for coordinate, *column in columns])
        return jnp.where(jnp.isnan(self.held), moved, self.held)

    def log_slopes(self, theta: Float[Array, " k"]) -> Float[Array, " k"]:
        """Return ln dx/dθ (k,), of each number by its own coordinate."""
        columns = zip(self.coordinates, theta, self.low, self.high, strict=True)
        return jnp.stack([coordinate._log_slope(*column) for coordinate, *column in columns])

    def tree_of(self, values: Float[Array, "*lanes k"], others: list[Any] | None = None) -> Any:
        """Return the pytree with the fitted numbers `values`, and other leaves if given."""
        leaves, at = [], 0
        others_left = iter(self.others if others is None else others)
        for shape in self.shapes:
            if shape is None:
                leaves.append(next(others_left))
                continue
            end = at + math.prod(shape)
            part = values[at:end] if values.ndim == 1 else values[..., at:end]
            leaf = part.reshape((*values.shape[:-1], *shape))
            # Transferred, not converted: JAX would compile a program for each new shape.
            leaves.append(leaf if isinstance(leaf, jax.Array) else jax.device_put(leaf))
            at = end
        return jax.tree.unflatten(self.structure, leaves)

    def stretch(self, values: np.ndarray) -> np.ndarray:
        """Return dx/dθ (k, ...) at values (k, ...), of each number by its own coordinate."""
        bounds = np.asarray(self.low), np.asarray(self.high)
        columns = zip(self.coordinates, values, *bounds, strict=True)
        return np.array([coordinate._slope(*column) for coordinate, *column in columns])

    @property
    def labels(self) -> tuple[str, ...]:
        """The names in these coordinates: "c", "ln c", "logit e"."""
        return tuple(c.label + name for c, name in zip(self.coordinates, self.names, strict=True))

    @property
    def has_unit(self) -> np.ndarray:
        """The mask (k,) of coordinates that are logarithms or logits."""
        return np.array([coordinate.has_unit for coordinate in self.coordinates])

    @property
    def bounded_above(self) -> np.ndarray:
        """The mask (k,) of coordinates that also have an upper bound."""
        return np.array([coordinate.bounded_above for coordinate in self.coordinates])


def space_of(start: Any, transforms: Any) -> tuple[Space, np.ndarray]:
    """Return the space of the numbers in `start`, and the coordinates of its values."""
    try:
        paths, structure = jax.tree.flatten_with_path(start)
    except (TypeError, ValueError) as error:  # keys of a dict that have no order
        raise refusal("start", "be a tree of numbers", start) from error
    chosen = _leaf_transforms(start, transforms)
    numbers: list[tuple[str, str, type[AbstractTransform], tuple[float, float], float]] = []
    shapes, others = [], []
    for (path, leaf), given in zip(paths, chosen, strict=True):
        if not _is_end(given):
            raise ValueError(
                "Argument `transforms` must hold `Free`, `Positive`, `Between` or `Fixed`, but "
                f"holds {rendered(given)}."
            )
        transform = given or _declared_transform(start, path)
        if not _is_fitted(leaf) or isinstance(transform, Fixed):
            shapes.append(None)
            others.append(jnp.asarray(float(leaf)) if type(leaf) is float else leaf)
            continue
        array, unit, name = as_numbers(leaf, "start"), _unit_of(start, path), _name_of(path)
        bounds, coordinate = (transform.low, transform.high), type(transform)
        allowed = Range(*bounds, low_open=True, high_open=True)
        shapes.append(array.shape)
        for index in np.ndindex(array.shape):
            place = name + (f"[{', '.join(map(str, index))}]" if index else "")
            value = float(array[index])
            if not allowed.holds(value):
                raise ValueError(
                    f"Argument `start` must have {place or 'its number'} in {allowed}, where it "
                    f"can move, but it is {value!r}."
                )
            free = coordinate._to_free(value, *bounds)
            numbers.append((place or "parameter", unit, coordinate, bounds, free))
    if not numbers:
        raise refusal("start", "hold a number to fit", start)
    names, units, coordinates, ends, theta = zip(*numbers, strict=True)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(
            f"Argument `start` must hold numbers of different names, but holds {first_few(twice)} "
            "twice."
        )
    # Assembled in NumPy: each JAX operation outside a compiled function is a program.
    low, high = jax.device_put(tuple(np.array(ends, float).T))
    held = jax.device_put(np.full(len(names), np.nan))
    keys = coordinates, tuple(shapes), names, units
    return Space(low, high, held, others, structure, *keys), np.array(theta)


def names_in(tree: Any) -> list[str]:
    """Return the names of all leaves."""
    return [_name_of(path) for path, _ in jax.tree.leaves_with_path(tree)]


def _name_of(path: tuple[Any, ...]) -> str:
    """Return the place of a leaf in words: `law.e`, `c`, `[0].mass`."""
    text = ""
    for key in path:
        match key:
            case GetAttrKey(name):
                # A leaf that could be static is named after the field that holds it.
                text += "" if name == "traced" else f".{name.lstrip('_')}"
            case DictKey(name):
                text += f".{name}"
            case SequenceKey(index) | FlattenedIndexKey(index):
                text += f"[{index}]"
    return text.lstrip(".")


def _is_fitted(leaf: Any) -> bool:
    if isinstance(leaf, bool | np.bool_ | np.timedelta64):
        return False
    if isinstance(leaf, np.ndarray | jax.Array):
        return eqx.is_inexact_array(leaf)
    # A single number, or a column of a data frame.
    return isinstance(leaf, int | float | complex | np.number) or hasattr(leaf, "__array__")


def _leaf_transforms(start: Any, transforms: Any) -> list[Any]:
    """Return the transform given for each leaf, None without one."""
    if isinstance(transforms, dict):
        return _transforms_by_name(start, transforms)
    chosen = []

    def give(transform: Any, part: Any) -> None:
        chosen.extend([transform] * jax.tree.structure(part).num_leaves)

    try:
        jax.tree.map(give, transforms, start, is_leaf=_is_end)
    except (ValueError, TypeError, KeyError) as error:
        raise ValueError(
            "Argument `transforms` must be one transform, a dict of them by name, or a prefix of "
            f"the tree of `start`, but is {rendered(transforms)}."
        ) from error
    return chosen


def _transforms_by_name(start: Any, transforms: dict[str, Any]) -> list[Any]:
    """Return transforms by the name of a number, or of its owner."""
    names = names_in(start)
    chosen = [None] * len(names)
    for wanted, transform in transforms.items():
        inside = f"{wanted}.", f"{wanted}["
        places = [i for i, name in enumerate(names) if name == wanted or name.startswith(inside)]
        if not places:
            known = ", ".join(filter(None, names)) or "which is one number without a name"
            raise ValueError(
                f"Argument `transforms` must name numbers of `start`, {known}, but names "
                f"{wanted!r}."
            )
        for i in places:
            chosen[i] = transform
    return chosen


def _is_end(x: Any) -> bool:
    return x is None or isinstance(x, AbstractTransform)


def _declared_transform(start: Any, path: tuple[Any, ...]) -> AbstractTransform:
    """Return the transform for the range that a module declares for its field."""
    allowed = _declaration(start, path).get("allowed")
    if allowed is None or (math.isinf(allowed.low) and math.isinf(allowed.high)):
        return Free()
    if allowed.low == 0 and math.isinf(allowed.high):
        return Positive()
    return Between(allowed.low, allowed.high)


def _unit_of(start: Any, path: tuple[Any, ...]) -> str:
    """Return the unit that a module declares for its field, or that of the name of a ranged one."""
    declared = _declaration(start, path)
    if declared.get("unit") is not None or "allowed" not in declared:
        # A number without a unit is printed bare.
        return (declared.get("unit") or "").removeprefix("-")
    return meaning(path[-1].name)[1]


def _declaration(start: Any, path: tuple[Any, ...]) -> Mapping[str, Any]:
    """Return the metadata of the module field at the end of a path; empty for other paths."""
    owner, declared = start, {}
    for key in path:
        match key:
            case GetAttrKey(name):
                fields = dataclasses.fields(owner) if isinstance(owner, eqx.Module) else ()
                declared = next((f.metadata for f in fields if f.name == name), {})
                owner = getattr(owner, name)
            case DictKey(index) | SequenceKey(index):
                owner, declared = owner[index], {}
            case _:
                return {}
    return declared

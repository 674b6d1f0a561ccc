"""The numbers of a pytree that are fitted: their names, bounds and free coordinates."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import DictKey, FlattenedIndexKey, GetAttrKey, SequenceKey
from jaxtyping import Array, Float

from .._parameter import Range, ranges
from ._transforms import AbstractTransform, Coordinate, Fixed, Free, of_range


class Space(eqx.Module):
    """Free coordinates θ (k,) of the fitted numbers in a pytree of parameters.

    `coordinates`, one for each number, select code; bounds and the other leaves are data.
    """

    low: Float[Array, " k"]
    high: Float[Array, " k"]
    others: list[Any]
    structure: Any = eqx.field(static=True)
    coordinates: tuple[Coordinate, ...] = eqx.field(static=True)
    shapes: tuple[tuple[int, tuple[int, ...]] | None, ...] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)

    def values(self, theta: Float[Array, " k"]) -> Float[Array, " k"]:
        """The fitted numbers themselves, in the order of their names."""
        columns = [
            coordinate.to_value(theta[i], self.low[i], self.high[i])
            for i, coordinate in enumerate(self.coordinates)
        ]
        return jnp.stack(columns)

    def params(self, theta: Float[Array, " k"]) -> Any:
        """The pytree of parameters."""
        return self.tree_of(self.values(theta))

    def tree_of(self, values: Float[Array, " k"]) -> Any:
        """The pytree that holds the fitted numbers `values`."""
        leaves, others, at = [], iter(self.others), 0
        for shape in self.shapes:
            if shape is None:
                leaves.append(next(others))
            else:
                count, own = shape
                leaves.append(values[at : at + count].reshape(own))
                at += count
        return jax.tree.unflatten(self.structure, leaves)

    def stretch(self, values: np.ndarray) -> np.ndarray:
        """dx/dθ (k,), of each number by its own coordinate."""
        bounds = zip(values, np.asarray(self.low), np.asarray(self.high), strict=True)
        return np.array([c.slope(*b) for c, b in zip(self.coordinates, bounds, strict=True)])

    @property
    def labels(self) -> tuple[str, ...]:
        """The names in these coordinates: "c", "ln c", "logit e"."""
        return tuple(c.label + name for c, name in zip(self.coordinates, self.names, strict=True))

    @property
    def has_unit(self) -> np.ndarray:
        """Which coordinates (k,) are logarithms or logits."""
        return np.array([coordinate.has_unit for coordinate in self.coordinates])

    @property
    def bounded_above(self) -> np.ndarray:
        """Which coordinates (k,) have a bound above, too."""
        return np.array([coordinate.bounded_above for coordinate in self.coordinates])


def space_of(start: Any, transforms: Any) -> tuple[Space, np.ndarray]:
    """The space of the numbers in `start`, and the coordinates of its values.

    Raises ValueError for a start outside its bounds, one that is not finite, transforms that do
    not match, and nothing to fit.
    """
    paths, structure = jax.tree_util.tree_flatten_with_path(start)
    chosen = _chosen(start, transforms)
    names, coordinates, shapes, others, low, high, theta = [], [], [], [], [], [], []
    for (path, leaf), given in zip(paths, chosen, strict=True):
        transform = given or _declared(start, path)
        if not _is_fitted(leaf) or isinstance(transform, Fixed):
            shapes.append(None)
            others.append(jnp.asarray(float(leaf)) if type(leaf) is float else leaf)
            continue
        array = np.asarray(leaf, float)
        shapes.append((array.size, array.shape))
        for index in np.ndindex(array.shape):
            name = name_of(path) + (f"[{', '.join(map(str, index))}]" if index else "")
            a, b = transform.bounds
            _check(name or "its number", float(array[index]), a, b)
            names.append(name or "parameter")
            coordinates.append(transform.coordinate)
            low.append(a)
            high.append(b)
            theta.append(transform.coordinate.to_free(float(array[index]), a, b))
    if not names:
        raise ValueError(f"Argument `start` must hold a number to fit, but is {start!r}.")
    space = Space(
        jnp.asarray(low, float),
        jnp.asarray(high, float),
        others,
        structure,
        tuple(coordinates),
        tuple(shapes),
        tuple(names),
    )
    return space, np.array(theta)


def name_of(path: tuple[Any, ...]) -> str:
    """A leaf's place in words: `law.e`, `c`, `[0].mass`."""
    text = ""
    for key in path:
        if isinstance(key, GetAttrKey):
            text += f".{key.name.removeprefix('_traced').lstrip('_')}"
        elif isinstance(key, DictKey):
            text += f".{key.key}"
        elif isinstance(key, SequenceKey):
            text += f"[{key.idx}]"
        elif isinstance(key, FlattenedIndexKey):
            text += f"[{key.key}]"
    return text.lstrip(".")


def _is_fitted(leaf: Any) -> bool:
    if isinstance(leaf, bool | np.bool_):
        return False
    return isinstance(leaf, float | int | np.floating) or eqx.is_inexact_array_like(leaf)


def _chosen(start: Any, transforms: Any) -> list[AbstractTransform | None]:
    """The transform given for each leaf; None where none was given."""
    if isinstance(transforms, dict):
        return _named(start, transforms)
    try:
        spread = jax.tree.map(
            lambda end, part: jax.tree.map(lambda _: _Held(end), part),
            transforms,
            start,
            is_leaf=_is_end,
        )
    except (ValueError, TypeError, KeyError) as error:
        raise ValueError(
            "Argument `transforms` must be one transform, a dict of them by name, or a prefix of "
            f"the tree of `start`, but is {transforms!r}."
        ) from error
    held = jax.tree.leaves(spread, is_leaf=lambda x: isinstance(x, _Held))
    return [_checked(one.transform) for one in held]


def _named(start: Any, transforms: dict[str, Any]) -> list[AbstractTransform | None]:
    """Transforms by the name of a number, or of what holds it."""
    names = [name_of(path) for path, _ in jax.tree_util.tree_flatten_with_path(start)[0]]
    chosen: list[AbstractTransform | None] = [None] * len(names)
    for wanted, transform in transforms.items():
        places = [
            i
            for i, name in enumerate(names)
            if name == wanted or name.startswith((f"{wanted}.", f"{wanted}["))
        ]
        if not places:
            raise ValueError(
                f"Argument `transforms` must name numbers of `start`, {', '.join(names)}, but "
                f"names {wanted!r}."
            )
        for i in places:
            chosen[i] = _checked(transform)
    return chosen


def _is_end(x: Any) -> bool:
    return x is None or isinstance(x, AbstractTransform)


def _checked(transform: Any) -> AbstractTransform | None:
    if not _is_end(transform):
        raise ValueError(
            "Argument `transforms` must hold `Free`, `Positive`, `Between` or `Fixed`, but holds "
            f"{transform!r}."
        )
    return transform


class _Held:
    """A transform as a leaf: None would be no leaf at all."""

    def __init__(self, transform: Any):
        self.transform = transform


def _declared(start: Any, path: tuple[Any, ...]) -> AbstractTransform:
    """The transform that follows from the range that a module declares for its field."""
    owner = start
    for key in path[:-1]:
        if isinstance(key, GetAttrKey):
            owner = getattr(owner, key.name)
        elif isinstance(key, DictKey):
            owner = owner[key.key]
        elif isinstance(key, SequenceKey):
            owner = owner[key.idx]
        else:
            return Free()
    if path and isinstance(last := path[-1], GetAttrKey) and isinstance(owner, eqx.Module):
        allowed = ranges(owner).get(last.name)
        return Free() if allowed is None else of_range(allowed)
    return Free()


def _check(name: str, value: float, low: float, high: float) -> None:
    allowed = Range(low, high, low_open=True, high_open=True)
    if not allowed.holds(value):
        raise ValueError(
            f"Argument `start` must have {name} in {allowed}, where it can move, but it is "
            f"{value!r}."
        )

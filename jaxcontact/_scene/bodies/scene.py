"""A scene: bodies, their interactions, gravity, and periodic axes; one value for all pairs of
bodies, or a table by the names of the pair.
"""

from __future__ import annotations

import collections
import functools
import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..._contact import EXPONENT
from ..._coupled.modes import Number
from ..._entry import (
    POSITIVE,
    Specialised,
    is_list,
    is_plain,
    refusal,
    refuses_unknown,
    rendered,
    require_kind,
    traced,
)
from ..._friction import AbstractFriction
from ..._laws import AbstractLaw, require_no_adhesion
from ..resume import Start
from .bodies import AbstractBody, Sphere, shells_of, spheres_of, walls_of, words
from .entry import one_number, vector
from .overlap import require_apart

DEFAULT = "default"
"""The key of the entry for all pairs that are not named."""


class PairTable(eqx.Module):
    """Values by pair: `table[a][b]` is the index in `values` for bodies of kinds a and b. The kind
    of a body is its name; all unnamed bodies are one kind. -1 marks pairs without a value.
    """

    values: tuple[Any, ...]
    table: tuple[tuple[int, ...], ...] = eqx.field(static=True)

    @property
    def by_kind(self) -> tuple[tuple[int, ...], ...]:
        """The table, or () if one value serves all pairs."""
        alike = len(self.values) == 1 and not any(map(any, self.table))
        return () if alike else self.table


def kinds_of(names: Sequence[str | None]) -> tuple[tuple[str | None, ...], tuple[int, ...]]:
    """Return the distinct names in order, and the kind of each body."""
    different = tuple(dict.fromkeys(names))
    return different, tuple(different.index(name) for name in names)


def pair_table(
    argument: str,
    given: Any,
    check: Callable[[str, Any], Any],
    kinds: Sequence[str | None],
    meeting: Sequence[tuple[int, int]],
) -> PairTable:
    """Return the table of an argument: one value for all pairs, or a mapping by names.

    The names of a pair may be in either order. `check` converts a value, and `meeting` lists the
    pairs of kinds that may meet. Raises ValueError for unknown names, pairs given twice, and pairs
    that meet without a value.
    """
    count = len(kinds)
    if not isinstance(given, Mapping):
        return PairTable((check(argument, given),), ((0,) * count,) * count)
    if not given:
        raise refusal(argument, "have an entry", given)
    rows = _rows_named(argument, list(given), kinds)
    values = [check(argument, entry) for entry in given.values()]
    missing = next(((kinds[a], kinds[b]) for a, b in meeting if rows[a][b] < 0), None)
    if missing is not None:
        first, second = ("an unnamed body" if kind is None else repr(kind) for kind in missing)
        must = f"have an entry for {first} and {second}, which can meet, or a 'default'"
        raise refusal(argument, must, given)
    return PairTable(tuple(values), tuple(map(tuple, rows)))


def _rows_named(argument: str, keys: list[Any], kinds: Sequence[str | None]) -> list[list[int]]:
    """Return the place among the keys for each pair of kinds; -1 for pairs without a key."""
    default = next((k for k, key in enumerate(keys) if isinstance(key, str) and key == DEFAULT), -1)
    rows = [[default] * len(kinds) for _ in kinds]
    named: set[tuple[int, int]] = set()
    for place, key in enumerate(keys):
        if place != default:
            a, b = _kinds_named(argument, key, kinds)
            if (a, b) in named:
                raise ValueError(
                    f"Argument `{argument}` must name a pair once, but names {key} in both orders."
                )
            named |= {(a, b), (b, a)}
            rows[a][b] = rows[b][a] = place
    return rows


def _kinds_named(argument: str, key: Any, kinds: Sequence[str | None]) -> tuple[int, int]:
    """Return the kinds of a pair of names; raises ValueError for anything else."""
    if not (isinstance(key, tuple) and len(key) == 2 and all(isinstance(k, str) for k in key)):
        raise ValueError(
            f"Argument `{argument}` must have pairs of names, such as ('ball', 'table'), or "
            f"'default' as its keys, but has {rendered(key)}."
        )
    for name in key:
        if name not in kinds:
            listed = ", ".join(repr(kind) for kind in kinds if kind is not None) or "none"
            raise ValueError(
                f"Argument `{argument}` must name bodies of the scene ({listed}), but names "
                f"{name!r}."
            )
    return kinds.index(key[0]), kinds.index(key[1])


class Scene(eqx.Module):
    """Bodies and their interactions.

    - `bodies`: a list of `Sphere`, `Plane`, `Box` and `Shell`, in one, two or three dimensions.
    - `law`: a contact law for all pairs, or a mapping by pair, `{("ball", "table"): law, "default":
      law}`. The names of a pair may be in either order, and bodies may share a name.
    - `stiffness`: K in N/mⁿ, for all pairs or by pair in the same way. None uses Hertz's stiffness
      from radii and materials; a wall without material is rigid.
    - `exponent`: n in [1, 3].
    - `gravity`: in m/s², a vector.
    - `periodic`: the length in m of each periodic axis, None for the others. It must exceed four
      radii of every sphere, so that a pair meets through one image at a time.
    - `friction`: a friction law for all pairs, or by pair as `law`; None for no friction and no
      rotation. It needs two or three dimensions.

    Every number is a leaf. Raises ValueError for bodies that overlap at the start by more than
    rounding, for different dimensions, and if nothing moves. Pairs that can meet without a law, a
    stiffness or a friction law also raise it, and so does a spin or a moment of inertia without
    friction. Traced values are not compared; `simulate` flags bad ones.
    """

    bodies: tuple[AbstractBody, ...]
    law: PairTable
    stiffness: PairTable | None
    gravity: Float[Array, " D"] | None
    periodic: tuple[Number | None, ...]
    friction: PairTable | None
    _start: Start | None
    _exponent: Specialised
    _kinds: tuple[int, ...] = eqx.field(static=True)

    @refuses_unknown
    def __init__(
        self,
        bodies: Sequence[AbstractBody],
        law: AbstractLaw | Mapping[Any, AbstractLaw],
        *,
        stiffness: ArrayLike | Mapping[Any, ArrayLike] | None = None,
        exponent: ArrayLike = 1.5,
        gravity: ArrayLike | Sequence[ArrayLike] | None = None,
        periodic: Sequence[ArrayLike | None] | None = None,
        friction: AbstractFriction | Mapping[Any, AbstractFriction] | None = None,
    ):
        self.bodies = _bodies(bodies)
        dimensions = self.bodies[0].dimensions
        kinds, self._kinds = kinds_of([body.name for body in self.bodies])
        meeting = _meeting(self.bodies, self._kinds)
        self.law = pair_table("law", law, _law, kinds, meeting)
        self._exponent = _exponent(exponent)
        self.stiffness = None
        if stiffness is not None:
            self.stiffness = pair_table(
                "stiffness", stiffness, lambda k, x: one_number(x, k, POSITIVE), kinds, meeting
            )
        elif self._exponent.static != 1.5:
            raise refusal(
                "exponent", "be 1.5 where the stiffness follows from materials (Hertz)", exponent
            )
        self.friction = None
        if friction is not None:
            self.friction = pair_table("friction", friction, _friction, kinds, meeting)
            for single in self.law.values:
                require_no_adhesion(single, "in a scene with friction")
        _require_friction_to_turn(self.bodies, friction)
        self.gravity = None
        if gravity is not None:
            self.gravity = vector(gravity, "gravity")
            _same_dimensions("gravity", gravity, self.gravity.shape[0], dimensions)
            if not traced(self.gravity) and not np.any(np.asarray(self.gravity)):
                self.gravity = None
        self.periodic = _periodic(periodic, self.bodies, dimensions)
        self._start = None
        require_apart(self.bodies, self.periodic)

    @property
    def exponent(self) -> float | Number:
        """The exponent n of every contact: a float if it was given as a Python number."""
        return self._exponent.value

    @property
    def dimensions(self) -> int:
        """The number of dimensions: 1, 2 or 3."""
        return self.bodies[0].dimensions

    @property
    def spheres(self) -> tuple[Sphere, ...]:
        """The spheres in the order given; row k of a position belongs to the k-th sphere."""
        return tuple(sphere for _, sphere in spheres_of(self.bodies))

    def __repr__(self) -> str:
        counts = collections.Counter(type(body).__name__ for body in self.bodies)
        bodies = ", ".join(f"{count} {kind}" for kind, count in counts.items())
        tables = filter(None, (self.law, self.friction))
        laws = (dict.fromkeys(type(law).__name__ for law in table.values) for table in tables)
        return f"Scene({bodies}; {self.dimensions}D; {'; '.join(map(', '.join, laws))})"


def _bodies(value: Any) -> tuple[AbstractBody, ...]:
    allowed = "a list of `Sphere`, `Plane`, `Box` and `Shell`"
    if not is_list(value) or not value:
        raise refusal("bodies", f"be {allowed}", value)
    for k, body in enumerate(value):
        if not isinstance(body, AbstractBody):
            raise ValueError(
                f"Argument `bodies` must be {allowed}, but number {k} of it is {rendered(body)}."
            )
    dimensions = value[0].dimensions
    for k, body in enumerate(value):
        if body.dimensions != dimensions:
            raise ValueError(
                f"Argument `bodies` must be in one space, but {words(value, k)} has "
                f"{body.dimensions} dimensions and {words(value, 0)} has {dimensions}."
            )
    if all(body.fixed for body in value):
        raise ValueError(
            "Argument `bodies` must hold a sphere that is not fixed, but nothing in it moves: "
            f"{rendered([type(body).__name__ for body in value])}."
        )
    return tuple(value)


def _meeting(bodies: Sequence[AbstractBody], kinds: Sequence[int]) -> list[tuple[int, int]]:
    """Return the pairs of kinds that can meet: one of the bodies must move."""
    total = collections.Counter(kinds)
    moving = {kind for body, kind in zip(bodies, kinds, strict=True) if not body.fixed}
    pairs = itertools.combinations_with_replacement(range(len(total)), 2)
    return [(a, b) for a, b in pairs if {a, b} & moving and (a != b or total[a] > 1)]


def _single(kind: type, allowed: str, argument: str, value: Any) -> Any:
    """Return a law with one number of each kind; raises ValueError for anything else."""
    law = require_kind(argument, value, kind, f"{allowed}, or a mapping")
    for leaf in jax.tree.leaves(law):
        if eqx.is_array(leaf) and leaf.shape != ():
            raise refusal(argument, "hold one number of each kind", law)
    return law


_law = functools.partial(_single, AbstractLaw, "a contact law (see `list_laws`)")
_friction = functools.partial(_single, AbstractFriction, "a friction law, such as `RigidCoulomb`")


def _require_friction_to_turn(bodies: Sequence[AbstractBody], friction: Any) -> None:
    """Raise ValueError for spins without friction, and for friction in one dimension."""
    if friction is not None and bodies[0].dimensions == 1:
        raise refusal("friction", "be None in one dimension, where nothing slides", friction)
    if friction is not None:
        return
    for k, body in enumerate(bodies):
        for name in ("spin", "inertia"):
            value = getattr(body, name, None)
            if value is not None:
                raise ValueError(
                    f"Argument `friction` must be given where {words(bodies, k)} has a `{name}`, "
                    "as nothing turns without friction, but is None; `RigidCoulomb(mu=0.0)` keeps "
                    "the spins."
                )


def _exponent(entry: Any) -> Specialised:
    value = one_number(entry, "exponent", EXPONENT)
    return Specialised(float(entry)) if is_plain(entry) else Specialised(None, value)


def _same_dimensions(name: str, value: Any, count: int, dimensions: int) -> None:
    if count != dimensions:
        raise refusal(name, f"have {dimensions} numbers, as the bodies have", value)


def _periodic(
    value: Any, bodies: Sequence[AbstractBody], dimensions: int
) -> tuple[Array | None, ...]:
    if value is None:
        return (None,) * dimensions
    if not is_list(value):
        raise refusal("periodic", "be a list with a length or None for each axis", value)
    _same_dimensions("periodic", value, len(value), dimensions)
    lengths = tuple(None if x is None else one_number(x, "periodic", POSITIVE) for x in value)
    for axis, length in enumerate(lengths):
        if length is not None:
            _require_room(value, axis, length, bodies)
    return lengths


def _require_room(value: Any, axis: int, length: Array, bodies: Sequence[AbstractBody]) -> None:
    """Raise ValueError for a body that ends the space along a periodic axis, or is too large."""
    shells = shells_of(bodies)
    if shells:
        raise refusal("periodic", f"be None beside {words(bodies, shells[0][0])}", value)
    for k, wall in walls_of(bodies):
        along = wall.normal[axis]
        if not traced(along) and float(along) != 0:
            must = f"be None for axis {axis}, along which {words(bodies, k)} ends the space"
            raise refusal("periodic", must, value)
    radii = [float(ball.radius) for _, ball in spheres_of(bodies) if not traced(ball.radius)]
    if radii and not traced(length) and float(length) <= 4 * max(radii):
        raise ValueError(
            f"Argument `periodic` must be longer than four radii ({4 * max(radii):g}), so that a "
            f"pair meets by one image at a time, but is {rendered(value)}."
        )

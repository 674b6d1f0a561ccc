"""A scene: bodies, their interactions, gravity, and periodic axes; one value for all pairs of
bodies, or a table by the names of the pair.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from ..._contact import EXPONENT
from ..._coupled.modes import Number
from ..._entry import POSITIVE, Specialised, is_plain, refuses_unknown, rendered, require_kind
from ..._friction import AbstractFriction
from ..._laws import AbstractLaw, require_no_adhesion
from ..resume import Start
from .bodies import AbstractBody, Shell, Sphere, words
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
    def alike(self) -> bool:
        """True if one value serves all pairs."""
        return len(self.values) == 1 and all(k == 0 for row in self.table for k in row)


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
        value = check(argument, given)
        return PairTable((value,), tuple((0,) * count for _ in range(count)))
    if not given:
        raise ValueError(f"Argument `{argument}` must have an entry, but is {rendered(given)}.")
    default, rows = -1, [[-1] * count for _ in range(count)]
    for place, key in enumerate(given):
        if isinstance(key, str) and key == DEFAULT:
            default = place
            continue
        a, b = _kinds_named(argument, key, kinds)
        if rows[a][b] >= 0:
            raise ValueError(
                f"Argument `{argument}` must name a pair once, but names {key} in both orders."
            )
        rows[a][b] = rows[b][a] = place
    values = [check(argument, entry) for entry in given.values()]
    table = tuple(tuple(default if k < 0 else k for k in row) for row in rows)
    for a, b in meeting:
        if table[a][b] < 0:
            first, second = (
                "an unnamed body" if kinds[k] is None else repr(kinds[k]) for k in (a, b)
            )
            raise ValueError(
                f"Argument `{argument}` must have an entry for {first} and {second}, which can "
                f"meet, or a 'default', but is {rendered(given)}."
            )
    return PairTable(tuple(values), table)


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
            self.stiffness = pair_table("stiffness", stiffness, _stiffness, kinds, meeting)
        elif self._exponent.static != 1.5:
            raise ValueError(
                "Argument `exponent` must be 1.5 where the stiffness follows from materials "
                f"(Hertz), but is {rendered(exponent)}."
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
            if not isinstance(self.gravity, Tracer) and not np.any(np.asarray(self.gravity)):
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
        return tuple(body for body in self.bodies if isinstance(body, Sphere))

    def __repr__(self) -> str:
        counts: dict[str, int] = {}
        for body in self.bodies:
            kind = type(body).__name__
            counts[kind] = counts.get(kind, 0) + 1
        bodies = ", ".join(f"{count} {kind}" for kind, count in counts.items())
        laws = ", ".join(dict.fromkeys(type(law).__name__ for law in self.law.values))
        rubs = (
            ""
            if self.friction is None
            else "; " + ", ".join(dict.fromkeys(type(law).__name__ for law in self.friction.values))
        )
        return f"Scene({bodies}; {self.dimensions}D; {laws}{rubs})"


def _bodies(value: Any) -> tuple[AbstractBody, ...]:
    if not isinstance(value, list | tuple) or not value:
        raise ValueError(
            "Argument `bodies` must be a list of `Sphere`, `Plane`, `Box` and `Shell`, but is "
            f"{rendered(value)}."
        )
    for k, body in enumerate(value):
        if not isinstance(body, AbstractBody):
            raise ValueError(
                "Argument `bodies` must be a list of `Sphere`, `Plane`, `Box` and `Shell`, but "
                f"number {k} of it is {rendered(body)}."
            )
    dimensions = [body.dimensions for body in value]
    for k, count in enumerate(dimensions):
        if count != dimensions[0]:
            raise ValueError(
                f"Argument `bodies` must be in one space, but {words(value, k)} has {count} "
                f"dimensions and {words(value, 0)} has {dimensions[0]}."
            )
    if not any(isinstance(body, Sphere) and not body.fixed for body in value):
        raise ValueError(
            "Argument `bodies` must hold a sphere that is not fixed, but nothing in it moves: "
            f"{rendered([type(body).__name__ for body in value])}."
        )
    return tuple(value)


def _meeting(bodies: Sequence[AbstractBody], kinds: Sequence[int]) -> list[tuple[int, int]]:
    """Return the pairs of kinds that can meet: one of the bodies must move."""
    count = max(kinds) + 1
    total, moving = [0] * count, [0] * count
    for body, kind in zip(bodies, kinds, strict=True):
        total[kind] += 1
        moving[kind] += isinstance(body, Sphere) and not body.fixed
    return [
        (a, b)
        for a in range(count)
        for b in range(a, count)
        if (moving[a] and total[b] > (a == b)) or (moving[b] and total[a] > (a == b))
    ]


def _require_single_numbers(argument: str, law: AbstractLaw | AbstractFriction) -> None:
    for leaf in jax.tree.leaves(law):
        if eqx.is_array(leaf) and leaf.shape != ():
            raise ValueError(
                f"Argument `{argument}` must hold one number of each kind, but is {rendered(law)}."
            )


def _law(argument: str, value: Any) -> AbstractLaw:
    law = require_kind(
        argument, value, AbstractLaw, "a contact law (see `list_laws`), or a mapping"
    )
    _require_single_numbers(argument, law)
    return law


def _friction(argument: str, value: Any) -> AbstractFriction:
    law = require_kind(
        argument, value, AbstractFriction, "a friction law, such as `RigidCoulomb`, or a mapping"
    )
    _require_single_numbers(argument, law)
    return law


def _require_friction_to_turn(bodies: Sequence[AbstractBody], friction: Any) -> None:
    """Raise ValueError for spins without friction, and for friction in one dimension."""
    if friction is not None and bodies[0].dimensions == 1:
        raise ValueError(
            "Argument `friction` must be None in one dimension, where nothing slides, but is "
            f"{rendered(friction)}."
        )
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


def _stiffness(argument: str, value: Any) -> Array:
    return one_number(value, argument, POSITIVE)


def _exponent(entry: Any) -> Specialised:
    value = one_number(entry, "exponent", EXPONENT)
    return Specialised(float(entry)) if is_plain(entry) else Specialised(None, value)


def _same_dimensions(name: str, value: Any, count: int, dimensions: int) -> None:
    if count != dimensions:
        raise ValueError(
            f"Argument `{name}` must have {dimensions} numbers, as the bodies have, but is "
            f"{rendered(value)}."
        )


def _periodic(
    value: Any, bodies: Sequence[AbstractBody], dimensions: int
) -> tuple[Array | None, ...]:
    if value is None:
        return (None,) * dimensions
    if not isinstance(value, list | tuple):
        raise ValueError(
            "Argument `periodic` must be a list with a length or None for each axis, but is "
            f"{rendered(value)}."
        )
    _same_dimensions("periodic", value, len(value), dimensions)
    lengths = tuple(None if x is None else one_number(x, "periodic", POSITIVE) for x in value)
    spheres = [body for body in bodies if isinstance(body, Sphere)]
    for axis, length in enumerate(lengths):
        if length is None:
            continue
        for k, body in enumerate(bodies):
            if isinstance(body, Shell):
                raise ValueError(
                    f"Argument `periodic` must be None beside {words(bodies, k)}, but is "
                    f"{rendered(value)}."
                )
            for wall in body.walls():
                along = wall.normal[axis]
                if not isinstance(along, Tracer) and float(along) != 0:
                    raise ValueError(
                        f"Argument `periodic` must be None for axis {axis}, along which "
                        f"{words(bodies, k)} ends the space, but is {rendered(value)}."
                    )
        radii = [float(s.radius) for s in spheres if not isinstance(s.radius, Tracer)]
        if radii and not isinstance(length, Tracer) and not float(length) > 4 * max(radii):
            raise ValueError(
                f"Argument `periodic` must be longer than four radii ({4 * max(radii):g}), so "
                f"that a pair meets by one image at a time, but is {rendered(value)}."
            )
    return lengths

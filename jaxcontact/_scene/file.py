"""Scenes in TOML files."""

from __future__ import annotations

import importlib.resources
import inspect
import os
import tomllib
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from .._contact import Material
from .._entry import (
    POSITIVE,
    nearest,
    not_modelled,
    refusal,
    rendered,
    require_choice,
    require_count,
    require_number,
    require_path,
)
from .._friction import AbstractFriction
from .._laws import AbstractLaw, describe, get_law, list_laws
from .._text.files import read_whole
from .bodies.bodies import AbstractBody
from .bodies.motion import AbstractMotion, Steady, Vibration
from .bodies.random_spheres import random_spheres
from .bodies.scene import DEFAULT, Scene
from .simulate import simulate_scene

TIMES = 201
"""The number of output times if a file gives none."""

_PERIODIC = "a list with a length in m, or false, for each axis"


def examples() -> dict[str, str]:
    """Return the texts of the scenes that ship with the package, by name."""
    folder = importlib.resources.files("jaxcontact.data") / "scenes"
    files = sorted(folder.iterdir(), key=lambda file: file.name)
    return {file.name.removesuffix(".toml"): file.read_text("utf-8") for file in files}


def read_scene(
    file: str | os.PathLike[str] | None = None, *, example: str | None = None
) -> tuple[Scene, dict[str, Any]]:
    """Read a scene from a TOML file, with the arguments for `simulate`.

    ```python
    scene, how = jc.read_scene("my.toml")  # or example="line", "table" or "box"
    run = jc.simulate(scene, **how)
    ```

    The top level has `duration` and, optionally, the other arguments of `simulate` and `Scene`.
    `times` may be a count of evenly spaced times (default 201). `periodic` has false for each axis
    that is not periodic.

    Tables `[[sphere]]`, `[[plane]]`, `[[box]]`, `[[shell]]` and `[[random_spheres]]` have the
    arguments of the Python objects. Bodies are numbered kind by kind, in the order in which the
    kinds appear. `law` is the name of a law without parameters, or a table with its `name` and
    parameters. Each `[[pair]]` has two names as `bodies`, and a `law`, a `stiffness`, a `friction`
    or several of them. `friction` is a table with the `name` of a class, such as "RigidCoulomb",
    and its arguments. A `material` is the name of a table `[material.NAME]`. A `motion` is a table
    with `kind = "vibration"` or "steady" and its arguments.

    Raises ValueError for entries that are unknown, missing or out of range; the message names the
    file, the table and the key. Raises OSError for a file that cannot be read.
    """
    if (file is None) == (example is None):
        raise refusal(
            "file", "be the path of a file where no `example` is given, and None where one is", file
        )
    if example is None:
        path = require_path("file", file)
        source, raw = str(path), read_whole(path)
    else:
        texts = examples()
        source = f"example {require_choice('example', example, texts)!r}"
        raw = texts[example].encode()
    try:
        content = tomllib.loads(raw.decode())
    except UnicodeDecodeError as error:
        raise ValueError(f"{source} must be a text in UTF-8, but is not: {error}.") from error
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{source} must be TOML, but is not: {error}.") from error
    return _scene_of(_Place(source, "at the top"), content)


class _Place(NamedTuple):
    """A table of a file, as messages name it."""

    source: str
    table: str

    def error(self, words: str) -> ValueError:
        return ValueError(f"{self.source}, {self.table}: {words}")

    def inside(self, table: str) -> _Place:
        return _Place(self.source, table)

    def require_known(self, what: str, name: Any, names: Iterable[str]) -> None:
        """Raise ValueError for an unknown name, with the likely one as a suggestion."""
        names = list(names)
        if name in names:
            return
        near, why = nearest(name, names), not_modelled(str(name))
        hint = f": {why}." if why else f"; did you mean {near!r}?" if near else "."
        allowed = ", ".join(names) or "none here"
        raise self.error(f"{what} must be one of {allowed}, but is {rendered(name)}{hint}")

    def require_table(self, what: str, value: Any) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise self.error(f"{what} must be a table, but is {rendered(value)}.")
        return value

    def call(self, function: Callable[..., Any], entries: Mapping[str, Any]) -> Any:
        """Call a function with the entries of a table; errors and missing keys name the table."""
        arguments = inspect.signature(function).parameters
        for name in entries:
            self.require_known("a key", name, arguments)
        for name, argument in arguments.items():
            if argument.default is argument.empty and name not in entries:
                raise self.error(f"the key {name!r} must be given, but is missing.")
        try:
            return function(**entries)
        except ValueError as error:
            raise self.error(str(error)) from error


def _arguments_of(function: Callable[..., Any], *others: str) -> list[str]:
    return [name for name in inspect.signature(function).parameters if name not in others]


def _scene_of(top: _Place, content: dict[str, Any]) -> tuple[Scene, dict[str, Any]]:
    # Progress output is not part of a file.
    for_scene = _arguments_of(Scene, "bodies")
    for_run = _arguments_of(simulate_scene, "scene", "tell")
    known = [*for_run, *for_scene, *_BODIES, "pair", "material"]
    for name in content:
        top.require_known("a key or table", name, known)
    of_scene = {name: content[name] for name in for_scene if name in content}
    of_run = {name: content[name] for name in for_run if name in content}
    bodies = _bodies(top, content)
    if "periodic" in of_scene:
        of_scene["periodic"] = _periodic(top, of_scene["periodic"])
    of_scene |= _by_pair(top, content)
    if "law" not in of_scene:
        raise top.error("the key 'law' must be given, but is missing.")
    scene = top.call(Scene, {"bodies": bodies, **of_scene})
    return scene, _run_arguments(top, of_run)


_BODIES: dict[str, Callable[..., Any]] = {
    **{cls.__name__.lower(): cls for cls in AbstractBody.__subclasses__()},
    random_spheres.__name__: random_spheres,
}


def _bodies(top: _Place, content: Mapping[str, Any]) -> list[AbstractBody]:
    """Return the bodies of a file, kind by kind."""
    given = top.require_table("'material'", content.get("material", {}))
    materials = {}
    for name, table in given.items():
        entries = top.require_table(f"'material.{name}'", table)
        materials[name] = top.inside(f"[material.{name}]").call(Material, entries)
    bodies: list[AbstractBody] = []
    for kind, listed in content.items():
        for place, table in _tables(top, kind, listed) if kind in _BODIES else ():
            made = place.call(_BODIES[kind], _resolve(place, table, materials))
            bodies += [made] if isinstance(made, AbstractBody) else made
    return bodies


def _tables(top: _Place, kind: str, listed: Any) -> Iterable[tuple[_Place, dict[str, Any]]]:
    """Return the tables of one kind, each with its place in the file."""
    if not isinstance(listed, list) or not all(isinstance(table, dict) for table in listed):
        raise top.error(f"{kind!r} must be tables [[{kind}]], but is {rendered(listed)}.")
    return [(top.inside(f"[[{kind}]] number {k}"), table) for k, table in enumerate(listed, 1)]


def _resolve(
    place: _Place, table: Mapping[str, Any], materials: Mapping[str, Material]
) -> dict[str, Any]:
    """Return the table of a body with its named material and motion resolved."""
    entries = dict(table)
    if "material" in entries:
        place.require_known("'material'", entries["material"], materials)
        entries["material"] = materials[entries["material"]]
    if "motion" in entries:
        entries["motion"] = _motion(place, entries["motion"])
    if "periodic" in entries:
        entries["periodic"] = _periodic(place, entries["periodic"])
    return entries


def _motion(place: _Place, value: Any) -> AbstractMotion:
    kinds: dict[Any, type[AbstractMotion]] = {"steady": Steady, "vibration": Vibration}
    table = dict(place.require_table("'motion'", value))
    kind = table.pop("kind", None)
    place.require_known("'kind' of the motion", kind, kinds)
    return place.inside(f"{place.table}, motion").call(kinds[kind], table)


def _law(place: _Place, value: Any) -> AbstractLaw:
    table = {"name": value} if isinstance(value, str) else dict(place.require_table("'law'", value))
    name = str(table.pop("name", None))
    place.require_known("'name' of the law", name, list_laws())
    wanted = describe(name).parameters
    for key in table:
        place.require_known(f"a parameter of {name}", key, wanted)
    for key in wanted:
        if key not in table:
            raise place.error(f"the law {name} must have its parameter {key!r}, but it is missing.")
    try:
        return get_law(name, **table)
    except ValueError as error:
        raise place.error(str(error)) from error


def _friction(place: _Place, value: Any) -> AbstractFriction:
    kinds = {kind.__name__: kind for kind in AbstractFriction.__subclasses__()}
    table = dict(place.require_table("'friction'", value))
    name = str(table.pop("name", None))
    place.require_known("'name' of the friction", name, kinds)
    return place.call(kinds[name], table)


_READERS: dict[str, Callable[[_Place, Any], Any]] = {
    "law": _law,
    "friction": _friction,
    "stiffness": lambda place, value: value,
}


def _by_pair(top: _Place, content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the law, the stiffness and the friction of a scene: one for all, or by pair with a
    default.
    """
    arguments = {
        name: read(top.inside(f"[{name}]"), content[name])
        for name, read in _READERS.items()
        if name in content
    }
    tables: dict[str, dict[Any, Any]] = {}
    for place, table in _tables(top, "pair", content.get("pair", [])):
        pair = _pair(place, table)
        for name in filter(table.__contains__, _READERS):
            values = tables.setdefault(name, {})
            if pair in values:
                raise place.error(
                    f"'bodies' must name a pair once, but is {rendered(table['bodies'])}."
                )
            values[pair] = _READERS[name](place, table[name])
    for name, table in tables.items():
        arguments[name] = table | ({DEFAULT: arguments[name]} if name in arguments else {})
    return arguments


def _pair(place: _Place, table: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of a pair, from its table."""
    for name in table:
        place.require_known("a key", name, ["bodies", *_READERS])
    bodies = table.get("bodies")
    pair = tuple(bodies) if isinstance(bodies, list) else ()
    if len(pair) != 2 or not all(isinstance(name, str) for name in pair):
        raise place.error(f"'bodies' must be two names, but is {rendered(bodies)}.")
    if len(table) < 2:
        raise place.error(
            "a 'law', a 'stiffness' or a 'friction' must be given, but all are missing."
        )
    return pair


def _periodic(place: _Place, value: Any) -> list[Any]:
    """Return the lengths, with None where the file has false, since TOML has no None."""
    if not isinstance(value, list):
        raise place.error(f"'periodic' must be {_PERIODIC}, but is {rendered(value)}.")
    return [None if length is False else length for length in value]


def _run_arguments(top: _Place, entries: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of `simulate`, with explicit times."""
    if "duration" not in entries:
        raise top.error("the key 'duration' must be given, but is missing.")
    try:
        duration = require_number("duration", entries["duration"], POSITIVE)
        times = entries.get("times", TIMES)
        if not isinstance(times, list):
            times = np.linspace(0, duration, require_count("times", times, 2))
    except ValueError as error:
        raise top.error(str(error)) from error
    return entries | {"duration": duration, "times": times}

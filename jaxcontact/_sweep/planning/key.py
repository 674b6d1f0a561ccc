"""Keys of functions: functions with equal keys compute the same.

A function is identified by its behaviour, not by its identity: its code, its defaults, the cells of
its closure, and the globals named in its code. These are followed through the functions, classes
and modules of the user. Numbers and arrays count by their bits. Installed libraries do not change
while a program runs, so their objects count by identity.
"""

from __future__ import annotations

import dataclasses
import dis
import enum
import functools
import hashlib
import sys
import sysconfig
import types
from collections.abc import Hashable, Iterable, Iterator
from typing import Any

import jax
import numpy as np
from jax.core import Tracer

_MOST = 10_000
"""Objects examined; beyond this number, tracing again is no more expensive than the key."""

_PLAIN = (type(None), bool, int, str, bytes, type(...), type(NotImplemented), range)
_FROM_C = (types.BuiltinFunctionType, types.WrapperDescriptorType, types.MethodDescriptorType)
_FIXED = (np.dtype, np.ufunc, types.GenericAlias, types.UnionType, jax.Device)
_SLOTS = (types.MemberDescriptorType, types.GetSetDescriptorType)

# Class members that do not affect its programs, or repeat information of other members.
_BESIDE = {
    *("__dict__", "__weakref__", "__doc__", "__module__", "__qualname__", "__annotations__"),
    *("__annotate__", "__annotate_func__", "__annotations_cache__", "__firstlineno__"),
    *("__static_attributes__", "__abstractmethods__", "__abstractvars__", "__abstractclassvars__"),
    *("_abc_impl", "__dataclass_fields__", "__dataclass_params__", "__match_args__", "__slots__"),
    *("__orig_bases__", "__parameters__", "__signature__"),
}

_NO_NAMES: frozenset[str] = frozenset()


class NoKey(Exception):
    """An object has a state that cannot be read."""


@dataclasses.dataclass(frozen=True, eq=False)
class _Same:
    """Equality by identity of the object, which it keeps alive."""

    object: Any

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.object is self.object

    def __hash__(self) -> int:
        return id(self.object)


def key_of(*values: Any) -> Hashable:
    """Return a key of values and functions. Raises NoKey for objects with a hidden state."""
    reader = _Reader()
    key = tuple(reader.key(value) for value in values)
    try:
        hash(key)
    except TypeError as error:
        raise NoKey(str(error)) from error
    return key


class _Reader:
    """One walk through everything a function reaches; repeated objects are named by a number."""

    def __init__(self) -> None:
        self._seen: dict[tuple[int, frozenset[str]], int] = {}
        # A temporary object could pass its address on to another one.
        self._alive: list[Any] = []

    def key(self, value: Any, names: frozenset[str] = _NO_NAMES) -> Hashable:
        """Return the key of a value; `names` are the attributes that the code reads from it."""
        kind = type(value)
        if kind in _PLAIN:
            return kind, value
        if kind in (float, complex):
            # Signs of zeros count, and NaN equals itself.
            return kind, repr(value)
        if isinstance(value, np.ndarray | np.generic | jax.Array):
            return kind, *_array(value)
        here = id(value), _NO_NAMES if isinstance(value, types.FunctionType | type) else names
        if here in self._seen:
            return "seen", self._seen[here]
        self._seen[here] = len(self._seen)
        self._alive.append(value)
        if len(self._seen) > _MOST:
            raise NoKey("too many objects")
        return kind, *self._parts(value, names)

    def _parts(self, value: Any, names: frozenset[str]) -> Iterator[Hashable]:
        kind = type(value)
        if kind is types.FunctionType:
            yield from self._function(value)
        elif kind is types.MethodType:
            yield from self._all((value.__func__, value.__self__), names)
        elif isinstance(value, functools.partial):
            yield from self._all((value.func, value.args, value.keywords, vars(value)), names)
        elif isinstance(value, types.ModuleType):
            yield from self._module(value, names)
        elif isinstance(value, enum.Enum):
            yield from (_Same(kind), value.name)
        elif isinstance(value, type):
            yield from self._class(value)
        elif kind is property:
            yield from self._all((value.fget, value.fset), names)
        elif kind in (staticmethod, classmethod):
            yield self.key(value.__func__, names)
        elif kind is types.CellType:
            yield from self._all(_content(value), names)
        elif kind in (list, tuple):
            yield from self._all(value, names)
        elif kind in (dict, types.MappingProxyType):
            yield from self._all(value.items(), names)
        elif kind in (set, frozenset):
            yield frozenset(self._all(value, names))
        elif isinstance(value, tuple) and hasattr(value, "_fields"):
            yield self.key(kind)
            yield from self._all(value, names)
        elif kind in _FROM_C:
            owner = getattr(value, "__self__", None)
            fixed = owner is None or isinstance(owner, types.ModuleType)
            yield _Same(value) if fixed else self.key(owner, names)
            yield getattr(value, "__name__", "")
        elif isinstance(value, _FIXED) or kind is object:
            yield _Same(value)
        elif kind is jax.tree_util.PyTreeDef:
            yield value
        else:
            yield from self._instance(value, names)

    def _all(self, values: Iterable[Any], names: frozenset[str]) -> Iterator[Hashable]:
        return (self.key(value, names) for value in values)

    def _function(self, function: types.FunctionType) -> Iterator[Hashable]:
        code, places = function.__code__, function.__globals__
        # Not `__module__`, which a library's decorator copies from the inner function.
        is_users = not _is_installed(places.get("__name__"))
        state = function.__defaults__, function.__kwdefaults__, function.__closure__, vars(function)
        if not is_users:
            yield _Same(code)
            # A library function created for a user's function holds it in its closure.
            yield from self._all(state if "<locals>" in code.co_qualname else (), _NO_NAMES)
            return
        named = _names_in(code)
        yield from self._code(code)
        yield from self._all(state, named.attributes)
        for name in sorted(named.variables & places.keys()):
            yield name
            yield self.key(places[name], named.attributes)
        for name in sorted(named.imports & sys.modules.keys()):
            yield name
            yield self.key(sys.modules[name], named.attributes)

    def _code(self, code: types.CodeType) -> Iterator[Hashable]:
        yield code.co_code, code.co_exceptiontable, code.co_flags
        yield code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount
        yield code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars
        for const in code.co_consts:
            if isinstance(const, types.CodeType):
                yield tuple(self._code(const))
            else:
                yield self.key(const)

    def _module(self, module: types.ModuleType, names: frozenset[str]) -> Iterator[Hashable]:
        yield _Same(module)
        if not _is_installed(module.__name__):
            for name in sorted(names & vars(module).keys()):
                yield name
                yield self.key(vars(module)[name], names)

    def _class(self, kind: type) -> Iterator[Hashable]:
        yield _Same(kind)
        for base in kind.__mro__:
            if not _is_installed(base.__module__):
                for name, member in vars(base).items():
                    if name not in _BESIDE and not isinstance(member, _SLOTS):
                        yield name
                        yield self.key(member)

    def _instance(self, value: Any, names: frozenset[str]) -> Iterator[Hashable]:
        """Yield the contents of an object whose class is written in Python."""
        kind = type(value)
        slots = _slots(kind)
        if slots is None:
            wrapped = getattr(value, "__wrapped__", None)
            if not isinstance(wrapped, types.FunctionType):
                raise NoKey(f"a value of type {kind.__qualname__}")
            # Made by jax.jit or functools.cache, with options that cannot be read.
            yield _Same(value)
            yield self.key(wrapped)
            return
        yield self.key(kind)
        for name in slots:
            if hasattr(value, name):
                yield name
                yield self.key(getattr(value, name), names)
        yield from self._all(getattr(value, "__dict__", {}).items(), names)


@dataclasses.dataclass(frozen=True)
class _Named:
    """Names in code: variables that may be global, imported modules, and attributes."""

    variables: frozenset[str]
    imports: frozenset[str]
    attributes: frozenset[str]


@functools.lru_cache(1024)
def _names_in(code: types.CodeType) -> _Named:
    variables, imports, attributes = set(), set(), set()
    for step in dis.get_instructions(code):
        if step.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
            variables.add(step.argval)
        elif step.opname == "IMPORT_NAME":
            imports.add(step.argval)
        elif step.opname in ("LOAD_ATTR", "LOAD_METHOD", "IMPORT_FROM"):
            attributes.add(step.argval)
    for inner in code.co_consts:
        if isinstance(inner, types.CodeType):
            inner_names = _names_in(inner)
            variables |= inner_names.variables
            imports |= inner_names.imports
            attributes |= inner_names.attributes
    return _Named(frozenset(variables), frozenset(imports), frozenset(attributes))


@functools.lru_cache(4096)
def _is_installed(module: Any) -> bool:
    """Return whether a module belongs to Python, to this package or to an installed library."""
    root = str(module).partition(".")[0]
    if root == __name__.partition(".")[0] or root in sys.stdlib_module_names:
        return root != "__main__"
    file = getattr(sys.modules.get(str(module)), "__file__", None) or ""
    paths = sysconfig.get_paths()
    return file.startswith((paths["purelib"], paths["platlib"])) or "-packages/" in file


@functools.lru_cache(1024)
def _slots(kind: type) -> tuple[str, ...] | None:
    """Return the slot names of a class written in Python; None for a class written in C."""
    slots = [
        name
        for base in kind.__mro__
        for name, member in vars(base).items()
        if isinstance(member, types.MemberDescriptorType) and member.__objclass__ is base
    ]
    # Additional size beyond slots, dict and weak references is a state held in C.
    pointers = len(slots) + (kind.__dictoffset__ > 0) + (kind.__weakrefoffset__ > 0)
    room = object.__basicsize__ + 8 * pointers
    return tuple(slots) if kind.__basicsize__ <= room and kind.__itemsize__ == 0 else None


def _content(cell: types.CellType) -> tuple[Any, ...]:
    try:
        return (cell.cell_contents,)
    except ValueError:
        # The cell is still empty.
        return ()


def _array(value: Any) -> Iterator[Hashable]:
    yield value.shape
    yield str(value.dtype)
    if isinstance(value, jax.Array):
        if isinstance(value, Tracer):
            raise NoKey("a value that is being traced")
        yield getattr(value, "weak_type", False)
        if not isinstance(value.dtype, np.dtype):
            value = jax.random.key_data(value)
    plain = np.ascontiguousarray(value)
    if plain.dtype.hasobject:
        raise NoKey("an array of objects")
    yield hashlib.blake2b(plain.reshape(-1).view(np.uint8).data, digest_size=16).digest()

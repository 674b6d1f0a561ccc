"""A function prepared for a sweep: traced, analysed and compiled; and its signature as JSON. A
store with another signature is refused.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import re
from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.extend.core as core
import jax.numpy as jnp
import numpy as np

from ..export import version
from ..skip import Analysis, Constant, Place, Program, analysis_of, program_of
from ..table import OutputField
from .axes import SweepGrid, call
from .key import NoKey, key_of

VALUE = "value"
"""Name of the only field of an output without names."""

_REMEMBERED = 32
_NUMBER = jax.Array | np.ndarray | np.generic | float | int | bool


@dataclass(frozen=True, eq=False)
class Plan(Analysis):
    """The computation of a sweep, and the fields that result from it."""

    fields: tuple[OutputField, ...]


@dataclass(frozen=True)
class _Request:
    """A function over axes of some kinds; requests with equal keys have the same plan."""

    key: Hashable
    kinds: tuple[tuple[str, int | None, np.dtype], ...]
    rank: int
    function: Callable[..., Any] = dataclasses.field(compare=False)
    static: tuple[tuple[str, Any], ...] = dataclasses.field(compare=False)


def plan_of(function: Callable[..., Any], grid: SweepGrid) -> Plan:
    """Return the plan of a function over a grid, cached with all of its compiled functions."""
    try:
        # JAX's settings affect the trace too: precision, kind of random numbers.
        key = key_of(function, grid.static), *map(repr, jax.config.values.items())
    except NoKey:
        key = None
    request = _Request(key, grid.kinds, len(grid.dims), function, grid.static)
    return _plan(request) if key else _plan.__wrapped__(request)


@functools.lru_cache(_REMEMBERED)
def _plan(request: _Request) -> Plan:
    names, along, dtypes = zip(*request.kinds, strict=True) if request.kinds else ((), (), ())
    fields: list[OutputField] = []
    names_found: list[str] = []

    def flat(*values: jax.Array) -> list[jax.Array]:
        arguments = dict(zip(names, values, strict=True)) | dict(request.static)
        fields[:], arrays = fields_of(call(request.function, arguments))
        names_found[:] = arrays
        return [jnp.asarray(array) for array in arrays.values()]

    program = program_of(flat, [jax.ShapeDtypeStruct((), dtype) for dtype in dtypes])
    analysis = analysis_of(program, names_found, along, request.rank)
    return Plan(**vars(analysis), fields=tuple(fields))


def fields_of(output: Any) -> tuple[list[OutputField], dict[str, Any]]:
    """Return the fields of one lane's output, and its arrays by name.

    Fields without arrays (None, static values) are kept unchanged.
    """
    fields: list[OutputField] = []
    arrays: dict[str, Any] = {}
    for name, value in _named_fields(output):
        paths, structure = jax.tree_util.tree_flatten_with_path(value)
        leaves = {name + jax.tree_util.keystr(path): leaf for path, leaf in paths}
        if leaves and all(isinstance(leaf, _NUMBER) for leaf in leaves.values()):
            fields.append(OutputField(name, tuple(leaves), structure))
            arrays |= leaves
        else:
            fields.append(OutputField(name, constant=value))
    return fields, arrays


def _named_fields(output: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(output, Mapping):
        yield from ((str(name), value) for name, value in output.items())
    elif isinstance(output, tuple) and hasattr(output, "_asdict"):
        yield from output._asdict().items()  # pyright: ignore[reportAttributeAccessIssue]
    elif dataclasses.is_dataclass(output) and not isinstance(output, type):
        for field in dataclasses.fields(output):
            yield field.name, getattr(output, field.name)
    else:
        yield VALUE, output


# Removed from every text: addresses of objects differ between processes.
_ADDRESS = re.compile(r" at 0x[0-9a-f]+|0x[0-9a-f]{6,}")


def signature_of(plan: Plan, function: str, grid: SweepGrid, most: int) -> dict[str, Any]:
    """Return the traced function with its constants, the axes, and the versions."""
    return {
        "function": function,
        "program": _digest(_texts(plan.program)),
        # Equal programs may have different names of outputs.
        "outputs": list(plan.leaves),
        "constants": {f.name: _text(f.constant) for f in plan.fields if not f.arrays},
        "axes": {
            i.name: {
                "dimension": None if i.dim is None else grid.dims[i.dim],
                "length": int(i.values.size),
                "dtype": str(i.values.dtype),
                "from": repr(i.values.reshape(-1)[0].item()),
                "to": repr(i.values.reshape(-1)[-1].item()),
                "numbers": _digest(iter([np.ascontiguousarray(i.values).tobytes()])),
            }
            for i in grid.inputs
        },
        "fixed": {name: _text(value) for name, value in grid.static},
        "batch_size": most,
        "jaxcontact": version(),
        "jax": jax.__version__,
        "platform": jax.default_backend(),
    }


def _text(value: Any) -> str:
    return _ADDRESS.sub("", repr(value))


def _digest(parts: Iterator[bytes]) -> str:
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()


def _texts(program: Program) -> Iterator[bytes]:
    for step in program.steps:
        yield step.primitive.name.encode()
        for name in sorted(step.params):
            yield from _of_param(name, step.params[name])
        yield from map(_of_place, step.reads)
        yield str(step.writes).encode()
    yield from map(_of_place, program.outputs)


def _of_param(name: str, value: Any) -> Iterator[bytes]:
    yield f"{name}={_ADDRESS.sub('', str(value))}".encode()
    yield from map(_bytes, _constants(value))


def _constants(value: Any) -> Iterator[Any]:
    """Yield the constants of nested programs in a parameter; their text does not contain them."""
    for part in value if isinstance(value, tuple | list) else (value,):
        if isinstance(part, core.ClosedJaxpr):
            yield from part.consts
        if isinstance(part, core.ClosedJaxpr | core.Jaxpr):
            for eqn in part.eqns:
                yield from _constants(list(eqn.params.values()))


def _of_place(where: Place) -> bytes:
    return _bytes(where.value) if isinstance(where, Constant) else str(where).encode()


def _bytes(value: Any) -> bytes:
    if not isinstance(jnp.result_type(value), np.dtype):
        # A key of random numbers is represented by its data.
        value = jax.random.key_data(value)
    array = np.asarray(value)
    return f"{array.dtype}{array.shape}".encode() + array.tobytes()

"""The signature of a sweep as JSON; a store with another signature is refused."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from typing import Any

import jax
import jax.extend.core as core
import jax.numpy as jnp
import numpy as np

from ..export import version
from ..skip import Constant, Place, Program
from .axes import SweepGrid
from .plan import Plan

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

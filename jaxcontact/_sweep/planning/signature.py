"""What identifies a sweep: its traced program, and its signature as JSON. A store with another
signature is refused.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.extend.core as core
import jax.numpy as jnp
import numpy as np

from ..skip.program import Constant, Place, Program, programs_in
from .axes import SweepGrid

_REMEMBERED = 256

# Removed from every text: addresses of objects differ between processes.
_ADDRESS = re.compile(r" at 0x[0-9a-f]+|0x[0-9a-f]{6,}")
# A rule for batches restates the program beside it in the text.
_RULE = re.compile(r"\brule=.*")
# Python objects, which their text does not describe.
_OPAQUE = re.compile(r" at 0x|callback|debug_print")


@dataclass(frozen=True)
class ProgramKey:
    """Programs with equal digests compute the same, if the key is `whole`."""

    digest: str
    """Of the primitives and their parameters as text, without addresses, and of the constants."""
    whole: bool
    """False if the program calls Python objects, which their text does not describe."""


def key_of(program: Program) -> ProgramKey:
    """Return the key of a program; it is the same in every process."""
    digest, whole = hashlib.blake2b(digest_size=16), True
    for step in program.steps:
        kind = step.primitive.name
        whole = whole and not _OPAQUE.search(kind)
        _add(digest, kind.encode())
        for name in sorted(step.params):
            value = step.params[name]
            # JAX keeps the program of a function that it has traced, so that its text serves again.
            read = _of_program if isinstance(value, core.ClosedJaxpr) else _read
            opaque, text, *constants = read(value)
            whole = whole and (name == "rule" or not opaque)
            _add(digest, f"{name}={text}".encode(), *constants)
        for place in (*step.reads, str(step.writes)):
            _add(digest, _of_place(place))
    for place in program.outputs:
        _add(digest, _of_place(place))
    return ProgramKey(digest.hexdigest(), whole)


def _read(value: Any) -> tuple[Any, ...]:
    """Return whether a parameter has what its text does not describe, its text, and the constants
    of the programs in it.
    """
    text = str(value)
    constants = (_bytes(x) for inner in programs_in([value]) for x in _constants(inner))
    return bool(_OPAQUE.search(_RULE.sub("", text))), _ADDRESS.sub("", text), *constants


_of_program = functools.lru_cache(_REMEMBERED)(_read)


def _constants(program: core.ClosedJaxpr | core.Jaxpr) -> Iterator[Any]:
    """Yield the arrays of a nested program, which its text does not contain."""
    yield from getattr(program, "consts", ())
    for eqn in program.eqns:
        literals = (atom.val for atom in eqn.invars if isinstance(atom, core.Literal))
        yield from (value for value in literals if np.ndim(value))


def _of_place(where: Place | str) -> bytes:
    return _bytes(where.value) if isinstance(where, Constant) else str(where).encode()


def _bytes(value: Any) -> bytes:
    kind = jnp.result_type(value)
    if not isinstance(kind, np.dtype):
        # A key of random numbers is represented by its generator and its data.
        return str(kind).encode() + _bytes(jax.random.key_data(value))
    array = np.asarray(value)
    return f"{array.dtype}{array.shape}".encode() + array.tobytes()


def _add(digest: hashlib.blake2b, *parts: bytes) -> None:
    for part in parts:
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)


def _digest(values: np.ndarray) -> str:
    digest = hashlib.blake2b(digest_size=16)
    _add(digest, np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def version() -> str:
    """Return the installed version of this library."""
    try:
        return importlib.metadata.version("jaxcontact")
    except importlib.metadata.PackageNotFoundError:
        return "(not installed)"


def signature_of(
    key: ProgramKey,
    function: str,
    outputs: Iterable[str],
    constants: Mapping[str, Any],
    grid: SweepGrid,
    most: int,
) -> dict[str, Any]:
    """Return the traced function, its outputs and constants, the axes, and the versions."""
    return {
        "function": function,
        "program": key.digest,
        # Equal programs may have different names of outputs.
        "outputs": list(outputs),
        "constants": {name: _text(value) for name, value in constants.items()},
        "axes": {
            i.name: {
                "dimension": None if i.dim is None else grid.dims[i.dim],
                "length": int(i.values.size),
                "dtype": str(i.values.dtype),
                "from": repr(i.values.reshape(-1)[0].item()),
                "to": repr(i.values.reshape(-1)[-1].item()),
                "numbers": _digest(i.values),
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

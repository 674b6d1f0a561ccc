"""Results on disk, block by block: a killed run continues where it stopped."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import json
import os
import shutil
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from .._entry import require_path

if TYPE_CHECKING:
    import zarr

Place = tuple[slice, ...]
Read = TypeVar("Read")

_SIGNATURE = "jaxcontact_sweep"
_CHECKSUMS = "blocks/checksum"
# Unwritten values read as NaN or -1 by their kind, or as 0 if every value may occur.
_UNWRITTEN = {"f": np.nan, "c": np.nan, "i": -1}


@dataclass(frozen=True, eq=False)
class Stored:
    """The format of one array of a store: named dimensions, and the chunk that a block fills.

    A coordinate has `values`, which are written once.
    """

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    chunk: tuple[int, ...]
    dtype: np.dtype
    attributes: Mapping[str, Any] = field(default_factory=dict)
    values: np.ndarray | None = None


def coordinate(dim: str, values: np.ndarray, attributes: Mapping[str, Any] | None = None) -> Stored:
    """Return the format of numbers along one dimension; all of them are one chunk."""
    return Stored((dim,), values.shape, values.shape, values.dtype, attributes or {}, values)


class BlockStore:
    """Arrays on disk, in which each block fills whole chunks, and a checksum for every block.

    `arrays` holds them by name; each is read on access.

    A block is finished if the data read back match its checksum. A missing, truncated, altered or
    unwritten chunk therefore does not count, for any end of the process. No two blocks share a
    file, so processes may write different blocks at the same time.
    """

    def __init__(self, group: zarr.Group, blocks: Sequence[Mapping[str, Place]]):
        self._blocks = blocks
        names = dict.fromkeys(name for part in blocks for name in part)
        self.arrays: dict[str, Any] = {name: group[name] for name in names}
        self._checksums: Any = group[_CHECKSUMS]

    def is_finished(self, number: int) -> bool:
        """Read a block and return whether it is complete."""

        def matches() -> bool:
            if not (checksum := int(self._checksums[number])):
                return False
            places = self._blocks[number].items()
            return checksum == _checksum({name: self.arrays[name][at] for name, at in places})

        return bool(_readable(matches))

    def lacking(self) -> list[int]:
        """Return the blocks that were never written; the others are not checked."""
        return np.flatnonzero(np.asarray(self._checksums[...]) == 0).tolist()

    def write(self, number: int, arrays: Mapping[str, np.ndarray]) -> None:
        """Write a block, and last its checksum, which marks it as finished."""
        for name, place in self._blocks[number].items():
            self.arrays[name][place] = arrays[name]
        self._checksums[number] = np.uint64(_checksum(arrays))


def open_store(
    path: Path,
    signature: Mapping[str, Any],
    arrays: Mapping[str, Stored],
    blocks: Sequence[Mapping[str, Place]],
    coordinates: Mapping[str, Stored],
) -> BlockStore:
    """Open the store at `path`, created if missing; `blocks` lists the part filled by each block.

    `signature` contains everything the numbers depend on, as JSON. Raises ValueError if the
    existing store has another signature, or altered arrays or coordinates; the message lists the
    differences.
    """
    for part in blocks:
        assert all(_whole_chunks(arrays[name], place) for name, place in part.items())
    # Normalised by JSON, which turns tuples into lists.
    signature = json.loads(json.dumps(signature))
    if not path.exists() or (path.is_dir() and not any(path.iterdir())):
        _create(path, signature, arrays, len(blocks), coordinates)
    group = _existing(path)
    if odd := ", ".join(_differences(group.attrs[_SIGNATURE], signature)):
        raise ValueError(
            "Argument `store` must be a new path or the store of this same sweep, but "
            f"{path} differs in {odd}. Choose another path, or delete it."
        )
    wanted = {name: _describe(form) for name, form in (*arrays.items(), *coordinates.items())}
    wanted[_CHECKSUMS] = _describe(Stored(("",), (len(blocks),), (1,), np.dtype("uint64")))
    there = {
        name: _readable(lambda n=name: _describe_stored(group, n, n in coordinates))
        for name in wanted
    }
    if lacks := [name for name, found in there.items() if found is None]:
        raise ValueError(
            f"Argument `store` must be a whole store, but {path} lacks {lacks[0]!r}, or it cannot "
            "be read. Delete the store."
        )
    if odd := ", ".join(_differences(there, json.loads(json.dumps(wanted)))):
        raise ValueError(
            f"Argument `store` must be a store as it was written, but {path} was altered: {odd}. "
            "Delete it."
        )
    return BlockStore(group, blocks)


def local_folder(path: Any) -> Path:
    """Return the path of a store; ValueError for a remote address, and for anything but a path."""
    folder = require_path("store", path)
    if "://" in os.fspath(path):
        raise ValueError(
            "Argument `store` must be the path of a folder of this machine, but is "
            f"{str(path)!r}: remote stores are not supported. Sweep into a local folder and copy "
            "it, or mount the remote one."
        )
    return folder


def _describe(form: Stored) -> dict[str, Any]:
    """Return the properties that determine how the bytes of an array are read."""
    values = form.values
    return {
        "dims": [dim or None for dim in form.dims],
        "shape": form.shape,
        "chunk": form.chunk,
        "dtype": str(form.dtype),
        "attributes": form.attributes,
        **({} if values is None else {"checksum": _checksum({"": values})}),
    }


def _readable(read: Callable[[], Read]) -> Read | None:
    """Return the result of `read`; None for a file that is missing, truncated or altered."""
    try:
        return read()
    except PermissionError:
        raise
    except Exception:  # zarr, its codecs and JSON raise various errors for such a file
        return None


def _describe_stored(group: zarr.Group, name: str, with_values: bool) -> dict[str, Any]:
    """Return the same properties of an existing array."""
    array: Any = group[name]
    names: Any = array.metadata.dimension_names or [None] * len(array.shape)
    values = np.asarray(array[...]) if with_values else None
    form = Stored(names, array.shape, array.chunks, array.dtype, dict(array.attrs), values)
    return json.loads(json.dumps(_describe(form)))


def _zarr() -> Any:
    try:
        import zarr
    except ImportError as error:
        raise ImportError(
            "Argument `store` needs zarr: install it with pip install 'jaxcontact[data]'."
        ) from error
    return zarr


def _whole_chunks(array: Stored, place: Place) -> bool:
    return all(
        part.start % chunk == 0 and (part.stop % chunk == 0 or part.stop == length)
        for part, chunk, length in zip(place, array.chunk, array.shape, strict=True)
    )


def _create(
    path: Path,
    signature: Mapping[str, Any],
    arrays: Mapping[str, Stored],
    count: int,
    coordinates: Mapping[str, Stored],
) -> None:
    """Create an empty store beside `path` and move it there as a whole.

    If several processes do so at the same time, the first store is used.
    """
    zarr = _zarr()
    made = list(itertools.filterfalse(Path.exists, path.parents))
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    try:
        # xarray reads the names of coordinates that are not dimensions from here.
        others = " ".join(name for name, c in coordinates.items() if c.dims != (name,))
        attributes = {_SIGNATURE: signature, **({"coordinates": others} if others else {})}
        group = zarr.create_group(new, zarr_format=3, attributes=attributes)
        for name, form in (*arrays.items(), *coordinates.items()):
            array: Any = group.create_array(
                name,
                shape=form.shape,
                chunks=form.chunk,
                dtype=form.dtype,
                fill_value=_UNWRITTEN.get(form.dtype.kind, 0),
                dimension_names=form.dims,
                attributes=dict(form.attributes),
            )
            if form.values is not None:
                array[:] = form.values
        # In its own group, so that it is not read as a result.
        group.create_array(_CHECKSUMS, shape=(count,), chunks=(1,), dtype="uint64", fill_value=0)
        os.rename(new, path)
    except OSError:
        if not path.exists():
            raise
    finally:
        shutil.rmtree(new, ignore_errors=True)
        # Folders created in vain are empty again.
        for folder in made:
            with contextlib.suppress(OSError):
                folder.rmdir()


def _existing(path: Path) -> zarr.Group:
    zarr = _zarr()
    group = _readable(lambda: zarr.open_group(path, mode="r+", zarr_format=3))
    if group is None or _SIGNATURE not in group.attrs:
        raise ValueError(
            f"Argument `store` must be a new path or the store of a sweep, but {path} is neither."
        )
    return group


def _differences(there: Any, here: Any, key: str = "") -> Iterator[str]:
    """Yield the differences of two JSON values: keys joined by dots, with both values."""
    if isinstance(there, dict) and isinstance(here, dict):
        for name in here | there:
            inner = f"{key}.{name}" if key else name
            yield from _differences(there.get(name), here.get(name), inner)
    elif there != here:
        old, new = ("none" if value is None else repr(value) for value in (there, here))
        yield f"`{key}` ({old} there, {new} here)"


def _checksum(arrays: Mapping[str, np.ndarray]) -> int:
    """Return a checksum of the bytes of named arrays, never zero."""
    digest = hashlib.blake2b(digest_size=8)
    for name in sorted(arrays):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(arrays[name]).reshape(-1).view(np.uint8).data)
    return int.from_bytes(digest.digest(), "little") or 1

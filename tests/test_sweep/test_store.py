"""Blocks on disk: finished blocks, refused stores, and readability by other tools."""

import json
import os
import shutil
import sys

import numpy as np
import pytest

import jaxcontact as jc
from docs.run_code import DOCS, run
from jaxcontact._sweep.store import Stored, coordinate, open_store
from tests.test_sweep.lanes import same

zarr = pytest.importorskip("zarr")

SIGNATURE = {"fn": "restitution", "axes": {"e": "a1", "v": "b2"}, "version": "0.1.0"}
ARRAYS = {
    # The last blocks are short along both dimensions.
    "duration": Stored(("e", "v"), (10, 7), (4, 5), np.dtype("float64"), {"units": "s"}),
    "status": Stored(("e", "v"), (10, 7), (4, 5), np.dtype("int32")),
    "flag": Stored((), (), (), np.dtype("bool")),
}
PLACES = [(slice(a, min(a + 4, 10)), slice(b, min(b + 5, 7))) for a in (0, 4, 8) for b in (0, 5)]
BLOCKS = [{"duration": place, "status": place} for place in PLACES] + [{"flag": ()}]
COORDINATES = {
    "e": coordinate("e", np.linspace(0.1, 1, 10)),
    "v": coordinate("v", np.arange(7.0), {"units": "m/s"}),
    "mass": coordinate("v", np.arange(7.0), {"units": "kg"}),
}

RNG = np.random.default_rng(0)
# Zeros are zarr's empty chunks in many settings; NaN and -0.0 compare badly but must be restored.
WHOLE = {
    "duration": np.where(RNG.random((10, 7)) < 0.2, np.nan, RNG.normal(size=(10, 7))),
    "status": np.zeros((10, 7), np.int32),
    "flag": np.array(True),
}
WHOLE["duration"][0, 0] = -0.0


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.zarr"


def opened(path, signature=SIGNATURE):
    return open_store(path, signature, ARRAYS, BLOCKS, COORDINATES)


def part(number, arrays=WHOLE):
    return {name: arrays[name][place] for name, place in BLOCKS[number].items()}


def filled(path):
    store = opened(path)
    for number in range(len(BLOCKS)):
        store.write(number, part(number))
    return store


def finished(store):
    return [number for number in range(len(BLOCKS)) if store.is_finished(number)]


def test_blocks_come_back_bit_for_bit(path):
    store = opened(path)
    assert finished(store) == []
    for number in (3, 6, 0):
        store.write(number, part(number))
    again = opened(path)
    assert finished(again) == [0, 3, 6]
    assert again.lacking() == [1, 2, 4, 5]
    for number in (0, 3, 6):
        assert same(part(number, again.arrays), part(number))
    arrays = filled(path).arrays
    assert same({name: np.asarray(array[...]) for name, array in arrays.items()}, WHOLE)


def test_no_two_blocks_share_a_file(path):
    """So that processes can write at the same time."""

    def written():
        return {file: file.stat().st_mtime_ns for file in path.rglob("*") if "/c" in str(file)}

    store = opened(path)
    for number in range(len(BLOCKS)):
        before = written()
        store.write(number, part(number))
        after = written()
        assert [file for file in before if file.is_file() and after[file] != before[file]] == []


CHUNK = "duration/c/2/1", 5
CHECKSUM = "blocks/checksum/c/1", 1


@pytest.mark.parametrize(
    ("file", "number", "damage"),
    [
        *((*CHUNK, damage) for damage in ("missing", "short", "empty", "altered", "swapped")),
        *((*CHECKSUM, damage) for damage in ("missing", "empty")),
    ],
)
def test_what_is_damaged_is_found_and_can_be_written_again(path, file, number, damage):
    filled(path)
    file = path / file
    content = file.read_bytes()
    middle = len(content) // 2
    if damage == "missing":
        file.unlink()
    else:
        file.write_bytes(
            {
                "short": content[:-3],
                "empty": b"",
                "altered": content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :],
                "swapped": (path / "duration/c/0/1").read_bytes(),
            }[damage]
        )
    store = opened(path)
    assert finished(store) == [other for other in range(7) if other != number]
    store.write(number, part(number))
    assert finished(opened(path)) == list(range(7))
    assert same(part(number, store.arrays), part(number))


def test_a_block_without_its_checksum_does_not_count(path, monkeypatch):
    """A process killed between the last array and the checksum."""
    store = opened(path)

    def killed(arrays):
        raise KeyboardInterrupt

    monkeypatch.setattr("jaxcontact._sweep.store._checksum", killed)
    with pytest.raises(KeyboardInterrupt):
        store.write(0, part(0))
    monkeypatch.undo()
    assert finished(opened(path)) == []


def entry(name, key, value):
    """Return a change of the metadata of an array."""

    def change(path):
        file = path / name / "zarr.json"
        file.write_text(json.dumps(json.loads(file.read_text()) | {key: value}))

    return change


def altered_coordinate(path):
    zarr.open_group(path, mode="r+")["v"][3] = -3.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"axes": {"e": "a1", "v": "c3"}}, "`axes.v` ('b2' there, 'c3' here)"),
        ({"axes": {"e": "a1"}}, "`axes.v` ('b2' there, none here)"),
        ({"batch_size": 5}, "`batch_size` (none there, 5 here)"),
        (entry("duration", "attributes", {"units": "ms"}), "`duration.attributes.units` ('ms' th"),
        (entry("duration", "shape", [10, 8]), "`duration.shape` ([10, 8] there, [10, 7] here)"),
        (entry("duration", "dimension_names", ["v", "e"]), "`duration.dims` (['v', 'e'] there"),
        (entry("status", "data_type", "int64"), "`status.dtype` ('int64' there, 'int32' here)"),
        (entry("status", "data_type", "colour"), "lacks 'status', or it cannot be read"),
        (entry("e", "attributes", {"units": "K"}), "`e.attributes.units` ('K' there, none here)"),
        (entry("blocks/checksum", "shape", [3]), "`blocks/checksum.shape` ([3] there, [7] here)"),
        (entry("", "zarr_format", 7), "must be a new path or the store of a sweep"),
        (altered_coordinate, "was altered: `v.checksum`"),
        (lambda path: shutil.rmtree(path / "status"), "lacks 'status'"),
    ],
)
def test_another_sweep_or_an_altered_store_is_refused(path, change, words):
    filled(path)
    altered = callable(change)
    if altered:
        change(path)
    with pytest.raises(ValueError, match="Argument `store` must be") as error:
        opened(path, SIGNATURE if altered else SIGNATURE | change)
    assert words in str(error.value)
    assert altered or finished(opened(path)) == list(range(7))


def test_what_is_no_store_is_refused(tmp_path):
    (tmp_path / "file").write_text("not a store")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "thesis.txt").write_text("not to be lost")
    zarr.create_group(tmp_path / "other.zarr", zarr_format=3)
    for name in ("file", "folder", "other.zarr"):
        with pytest.raises(ValueError, match=f"Argument `store` must .*{name} is neither"):
            opened(tmp_path / name)
    assert (tmp_path / "folder" / "thesis.txt").read_text() == "not to be lost"


@pytest.mark.parametrize("path", ["s3://bucket/x", "gs://bucket/x", "file:///tmp/x"])
def test_what_is_no_path_of_this_machine_is_refused(path):
    with pytest.raises(ValueError, match="Argument `store` must be the path"):
        jc.sweep(lambda e: e, e=[1.0], store=path)


def test_a_store_that_cannot_be_made_leaves_nothing(tmp_path, monkeypatch):
    def full(*args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "rename", full)
    with pytest.raises(OSError, match="No space left"):
        opened(tmp_path / "runs" / "today" / "a.zarr")
    assert list(tmp_path.iterdir()) == []


def test_a_new_store_may_be_deep_or_an_empty_folder(tmp_path):
    opened(tmp_path / "runs" / "today" / "a.zarr")
    (tmp_path / "empty").mkdir()
    opened(tmp_path / "empty")
    # Temporary files beside it are removed.
    assert sorted(p.name for p in tmp_path.iterdir()) == ["empty", "runs"]


def test_the_first_of_two_that_create_it_wins(path, monkeypatch):
    rename = os.rename

    def late(new, target):
        monkeypatch.setattr(os, "rename", rename)
        filled(path)
        rename(new, target)

    monkeypatch.setattr(os, "rename", late)
    assert finished(opened(path)) == list(range(7))
    assert list(path.parent.iterdir()) == [path]


def test_what_is_not_written_yet_cannot_be_taken_for_a_result(path):
    arrays = opened(path).arrays
    assert np.isnan(arrays["duration"][...]).all()
    assert (np.asarray(arrays["status"][...]) == -1).all()


def test_without_zarr(path, monkeypatch):
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(ImportError, match=r"pip install 'jaxcontact\[data\]'"):
        opened(path)


def test_the_code_of_the_page_runs():
    pytest.importorskip("xarray")
    assert len(list(run(DOCS / "sweeps.md"))) == 3

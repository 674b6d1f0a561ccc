"""A sweep into a store that was killed, damaged, or belongs to another sweep.

The files of docs/cluster: two processes as Slurm starts them, one of which is killed.
"""

import json
import os
import random
import re
import runpy
import shutil
import signal
import subprocess
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._sweep.planning.blocks import Workers
from jaxcontact._sweep.store import BlockStore
from tests.test_sweep import lanes
from tests.test_sweep.lanes import ROOT, arrays_of, many, outcome, same
from tests.test_sweep.test_table import Power

pytest.importorskip("zarr")


@pytest.fixture
def written(monkeypatch):
    return lanes.written_blocks(monkeypatch.setattr)


@pytest.fixture(scope="module")
def whole():
    """The sweep as it is without a store."""
    return arrays_of(many())


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    path = tmp_path_factory.mktemp("made") / "sweep.zarr"
    many(store=path)
    return path


@pytest.fixture
def store(made, tmp_path):
    """A finished store."""
    return shutil.copytree(made, tmp_path / "sweep.zarr")


def slower(e, v):
    return outcome(e, v / 2)


def swapped(e, v):
    """The same program, whose outputs have each other's names."""
    fields = vars(outcome(e, v))
    arrays = {name: value for name, value in fields.items() if isinstance(value, jnp.ndarray)}
    return dict(zip(list(arrays)[::-1], arrays.values(), strict=True))


def finished(path):
    """The blocks that count as finished."""
    return {int(p.name) for p in path.glob("blocks/checksum/c/*") if p.name.isdigit()}


def files(path):
    """The content of a store; zarr leaves `.partial` files behind when it is killed."""
    every = [p for p in path.rglob("*") if p.is_file() and p.suffix != ".partial"]
    return {str(p.relative_to(path)): p.read_bytes() for p in every}


# Slow enough to be interrupted in the middle.
SLOW = """
import json, time
print(json.dumps(digests()), flush=True)
many(store=sys.argv[1], progress=lambda done, total: time.sleep(0.3))
"""


def test_a_killed_sweep_goes_on_where_it_was(tmp_path, written, whole):
    path = tmp_path / "sweep.zarr"
    command = [*lanes.script(SLOW), path]
    child = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    try:
        while len(finished(path)) < 3:
            assert child.poll() is None
            time.sleep(0.01)
    finally:
        child.kill()
    assert child.wait() == -signal.SIGKILL
    # Both processes name a program alike.
    assert json.loads(child.communicate()[0]) == lanes.digests()
    there, seen = len(finished(path)), []
    resumed = many(store=path, progress=lambda done, total: seen.append((done, total)))
    blocks = len(finished(path))
    assert 3 <= there < blocks
    assert len(written) == len(set(written)) == blocks - there
    assert same(arrays_of(resumed), whole)
    assert seen[-1][0] == seen[-1][1]
    assert 0 < resumed.resumed < 1
    assert f"resumed {100 * resumed.resumed:.0f} % of the work was in the store" in repr(resumed)
    unstored = many()
    assert unstored.resumed == 0 and "resumed" not in repr(unstored)

    # The files also equal those of an uninterrupted sweep.
    many(store=tmp_path / "other.zarr")
    assert files(path) == files(tmp_path / "other.zarr")


def test_a_finished_store_is_read(store, written, whole):
    """What does not change a bit does not make another sweep; what is damaged is computed again."""
    mesh = jax.make_mesh((1,), ("lanes",), axis_types=(jax.sharding.AxisType.Auto,))
    for how in ({}, {"mesh": mesh}):
        assert same(arrays_of(many(store=store, **how)), whole) and not written
    chunk = next(p for p in (store / "duration" / "c").rglob("*") if p.is_file())
    os.truncate(chunk, chunk.stat().st_size // 2)
    assert same(arrays_of(many(store=store)), whole) and len(written) == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"fn": slower}, "`function` ('outcome' there, 'slower' here)"),
        ({"fn": lambda e, v: outcome(e, 2 * v)}, "`program`"),
        ({"fn": swapped}, "`outputs` (["),
        ({"v": jnp.linspace(0.0, 5, 8)}, "`axes.v.numbers`"),
        ({"v": np.linspace(0.0, 4, 9, dtype=np.float32)}, "`axes.v.dtype`"),
        ({"batch_size": 21}, "`batch_size` (20 there, 21 here)"),
        (None, "' there, '0.0.1' here)"),
    ],
    ids=["function", "program", "outputs", "numbers", "dtype", "batch size", "version"],
)
def test_another_sweep_is_refused(store, monkeypatch, change, words):
    before = files(store)
    if change is None:
        monkeypatch.setattr("jaxcontact._sweep.planning.signature.version", lambda: "0.0.1")
    with pytest.raises(ValueError, match="Argument `store` must be") as error:
        many(store=store, **(change or {}))
    assert words in str(error.value)
    assert change or "`jaxcontact` ('" in str(error.value)
    assert files(store) == before


def test_an_object_is_part_of_what_a_store_is_made_from(tmp_path):
    def swept(how):
        def function(e, how):
            return e**2

        return jc.sweep(function, e=[0.5, 0.7], how=how, store=tmp_path / "sweep.zarr").value

    swept(Power(2))
    assert np.array_equal(swept(Power(2)), [0.5**2, 0.7**2])
    with pytest.raises(ValueError, match=r"`fixed.how` \('.*2\)' there, '.*3\)' here\)"):
        swept(Power(3))
    # Its text holds its address, which is another one in every process.
    with pytest.raises(ValueError, match="'<object object>' here"):
        swept(object())


def test_processes_must_see_the_same_store(tmp_path, monkeypatch):
    """Two processes with a disk each would end with half of the blocks."""
    alone = Workers(process=1, processes=2)
    monkeypatch.setattr(sys.modules["jaxcontact._sweep.sweep"], "workers_of", lambda mesh: alone)
    monkeypatch.setattr(Workers, "meet", lambda self, where: None)
    with pytest.raises(ValueError, match=r"process 1 does not find .* blocks"):
        many(store=tmp_path / "sweep.zarr")


def test_xarray_opens_the_store(store, whole):
    """Arrays have the dimensions they depend on; where they hold is said beside them."""
    xarray = pytest.importorskip("xarray")
    table = xarray.open_zarr(store, consolidated=False, chunks=None)
    flags = xarray.open_zarr(store, consolidated=False, chunks=None, group="flags")
    assert np.array_equal(table.v, np.linspace(0, 4, 9))
    assert table.duration.attrs["units"] == "s"
    assert table.restitution.dims == ("e",)
    assert set(table) == set(whole) and set(table.coords) == {"e", "v"}
    for name, values in table.items():
        every = values
        for flag in values.attrs.get("valid_where", "").split():
            bad = np.int64(3) if name == "status" else np.nan
            every = every.where(flags[flag.removeprefix("flags/")], bad)
        stored = every.broadcast_like(table.duration).transpose("e", "v")
        assert np.array_equal(stored, whole[name], equal_nan=True)


FOLDER = ROOT / "docs" / "cluster"
PAGE = ROOT / "docs" / "sweeps.md"
PROCESSES, DEVICES = 2, 2


def started(path, process, job):
    """A process of the job, with the variables by which JAX knows Slurm."""
    slurm = {"JOB_ID": job, "NTASKS": PROCESSES, "PROCID": process, "LOCALID": process}
    slurm |= {"STEP_NODELIST": "localhost", "STEP_NUM_NODES": 1}
    given = {f"SLURM_{name}": str(value) for name, value in slurm.items()}
    env = lanes.environment(DEVICES) | given | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, FOLDER / "sweep.py", path]
    return subprocess.Popen(command, cwd=path.parent, env=env)


def page():
    return runpy.run_path(str(FOLDER / "sweep.py"), run_name="page")


@pytest.mark.slow(reason="new processes that compile for themselves")
def test_a_killed_process_costs_no_finished_block(tmp_path, written):
    pytest.importorskip("xarray")
    path = tmp_path / "sweep.zarr"
    job = random.randrange(1 << 20)  # JAX takes the port from it.
    first, second = (started(path, process, job) for process in range(PROCESSES))
    try:
        while sum(number % 2 for number in finished(path)) < 3:
            assert first.poll() is None and second.poll() is None
            time.sleep(0.005)
        second.kill()
        second.wait()
        lost = finished(path)
        # The other one finishes its blocks. Its end would take JAX's heartbeat, 100 s.
        count, last = 0, time.monotonic()
        while time.monotonic() < last + 2:
            if len(now := finished(path)) != count:
                count, last = len(now), time.monotonic()
            time.sleep(0.05)
    finally:
        for process in (first, second):
            process.kill()
            process.wait()
    there, sweep = finished(path), page()["sweep"]
    again = sweep(path)
    every = finished(path)
    assert every == set(range(len(every)))
    assert {number for number in every if number % 2 == 0} <= there
    assert {number for number in lost if number % 2} == {number for number in there if number % 2}
    assert sorted(written) == sorted(every - there)
    assert 0 < again.resumed < 1
    assert same(arrays_of(again), arrays_of(sweep()))


def test_a_process_holds_one_block_for_each_device_and_one_more(tmp_path, monkeypatch):
    """What is lost with it at most: blocks begun, and not yet in the store."""
    held, most = [0], [0]
    place, write = Workers.place, BlockStore.write

    def begun(workers, turn, arguments):
        held[0] += 1
        most[0] = max(most[0], held[0])
        return place(workers, turn, arguments)

    def kept(store, number, arrays):
        write(store, number, arrays)
        held[0] -= 1

    monkeypatch.setattr(Workers, "place", begun)
    monkeypatch.setattr(BlockStore, "write", kept)
    many(store=tmp_path / "sweep.zarr", mesh=jax.sharding.Mesh(jax.local_devices(), ("lanes",)))
    assert (held[0], most[0]) == (0, len(jax.local_devices()) + 1)


@pytest.mark.parametrize("name", ["sweep.py", "cpu.sbatch", "gpu.sbatch"])
def test_the_page_shows_the_files_and_a_batch_file_starts_the_script(name):
    text = (FOLDER / name).read_text(encoding="utf-8")
    language = "python" if name.endswith(".py") else "bash"
    assert f"```{language}\n{text}```" in PAGE.read_text(encoding="utf-8")
    if language == "bash":
        subprocess.run(["bash", "-n", FOLDER / name], check=True)
        lines = text.splitlines()
        options = [line for line in lines if line.startswith("#SBATCH ")]
        assert lines[0] == "#!/bin/bash" and lines[1] == options[0]
        assert all(re.fullmatch(r"--[a-z-]+(=\S+)?", word) for word in options[0].split()[1:])
        assert lines[-1].startswith("srun python sweep.py ")


def test_the_script_sweeps_what_the_page_says():
    hit = page()["impact"](0.5, 1.0)
    want = jc.impact(jc.HuGuo(e=0.5), jc.Contact(1.0, 1.4e8, 1.5), 1.0)
    assert np.array_equal(hit.duration, want.duration)

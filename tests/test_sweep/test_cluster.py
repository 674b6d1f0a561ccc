"""The files of docs/cluster: two processes as Slurm starts them, one of which is killed."""

import os
import random
import re
import runpy
import subprocess
import sys
import time

import jax
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._sweep.planning.blocks import Workers
from jaxcontact._sweep.store import BlockStore
from tests.test_sweep.lanes import ROOT, arrays_of, many, same

FOLDER = ROOT / "docs" / "cluster"
PAGE = ROOT / "docs" / "sweeps.md"
PROCESSES, DEVICES = 2, 2


def started(path, process, job):
    """A process of the job, with the variables by which JAX knows Slurm."""
    flags = f"{os.environ['XLA_FLAGS']} --xla_force_host_platform_device_count={DEVICES}"
    slurm = {"JOB_ID": job, "NTASKS": PROCESSES, "PROCID": process, "LOCALID": process}
    slurm |= {"STEP_NODELIST": "localhost", "STEP_NUM_NODES": 1}
    environment = os.environ | {f"SLURM_{name}": str(value) for name, value in slurm.items()}
    environment |= {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu", "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        [sys.executable, FOLDER / "sweep.py", path], cwd=path.parent, env=environment
    )


def finished(path):
    """The blocks that count as finished."""
    return {int(p.name) for p in path.glob("blocks/checksum/c/*") if p.name.isdigit()}


@pytest.mark.slow(reason="new processes that compile for themselves")
def test_a_killed_process_costs_no_finished_block(tmp_path, monkeypatch):
    pytest.importorskip("zarr")
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
    there, written, write = finished(path), [], BlockStore.write

    def counted(store, number, arrays):
        written.append(number)
        write(store, number, arrays)

    monkeypatch.setattr(BlockStore, "write", counted)
    page = runpy.run_path(str(FOLDER / "sweep.py"), run_name="page")
    again = page["sweep"](path)
    every = finished(path)
    assert every == set(range(len(every)))
    assert {number for number in every if number % 2 == 0} <= there
    assert {number for number in lost if number % 2} == {number for number in there if number % 2}
    assert sorted(written) == sorted(every - there)
    assert 0 < again.resumed < 1
    assert same(arrays_of(again), arrays_of(page["sweep"]()))


def test_a_process_holds_one_block_for_each_device_and_one_more(tmp_path, monkeypatch):
    """What is lost with it at most: blocks begun, and not yet in the store."""
    pytest.importorskip("zarr")
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
def test_the_page_shows_the_files(name):
    text = (FOLDER / name).read_text(encoding="utf-8")
    language = "python" if name.endswith(".py") else "bash"
    assert f"```{language}\n{text}```" in PAGE.read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["cpu.sbatch", "gpu.sbatch"])
def test_a_batch_file_starts_the_script(name):
    lines = (FOLDER / name).read_text(encoding="utf-8").splitlines()
    subprocess.run(["bash", "-n", FOLDER / name], check=True)
    options = [line for line in lines if line.startswith("#SBATCH ")]
    assert lines[0] == "#!/bin/bash" and lines[1] == options[0]
    assert all(re.fullmatch(r"--[a-z-]+(=\S+)?", word) for word in options[0].split()[1:])
    assert lines[-1].startswith("srun python sweep.py ")


def test_the_script_sweeps_what_the_page_says():
    page = runpy.run_path(str(FOLDER / "sweep.py"), run_name="page")
    hit = page["impact"](0.5, 1.0)
    want = jc.impact(jc.HuGuo(e=0.5), jc.Contact(1.0, 1.4e8, 1.5), 1.0)
    assert np.array_equal(hit.duration, want.duration)

"""Blocks over several devices and processes: no bit depends on their number.

In one file, and hence in one worker, which computes the common reference only once. All kinds of
meshes are accepted; anything but a mesh of this process is refused.
"""

import socket
import subprocess

import jax
import numpy as np
import pytest
from jax.sharding import AxisType, Mesh

from jaxcontact._sweep.planning.blocks import Workers, workers_of
from tests.test_sweep.lanes import ROOT, cheap, environment, folded, same, script, swept


@pytest.fixture(scope="module")
def on_one_device():
    """All methods and a gradient, computed here."""
    with jax.default_device(jax.devices("cpu")[0]):
        return swept()


FOUR = """
mesh = jax.make_mesh((4,), ("lanes",), axis_types=(jax.sharding.AxisType.Auto,))

# Where the blocks were computed.
from jaxcontact._sweep.planning.blocks import Workers
used, place = set(), Workers.place
def seen(workers, turn, arguments):
    arrays = place(workers, turn, arguments)
    used.update(device for array in arrays for device in array.devices())
    return arrays
Workers.place = seen

np.savez(sys.argv[1], **swept(mesh=mesh))
assert len(used) == 4
"""


@pytest.mark.slow(reason="new processes that compile for themselves")
def test_four_devices_equal_one_bit_for_bit(tmp_path, on_one_device):
    command = [*script(FOUR), tmp_path / "four.npz"]
    subprocess.run(command, check=True, cwd=ROOT, env=environment(4))
    four = dict(np.load(tmp_path / "four.npz"))
    assert same(four, on_one_device)
    assert all(np.isfinite(values).all() for values in four.values())


WORKER = """
process, address, folder = int(sys.argv[1]), sys.argv[2], sys.argv[3]
jax.distributed.initialize(address, num_processes=2, process_id=process)
assert (jax.process_count(), len(jax.local_devices()), len(jax.devices())) == (2, 2, 4)

# Of the store, in which both write at the same time.
written = written_blocks()

np.savez(f"{folder}/gathered-{process}.npz", **swept())
np.savez(f"{folder}/stored-{process}.npz", **swept(store=f"{folder}/sweep.zarr"))
np.savez(f"{folder}/written-{process}.npz", blocks=written)
mesh = jax.make_mesh((4,), ("lanes",), axis_types=(jax.sharding.AxisType.Auto,))
np.savez(f"{folder}/mesh-{process}.npz", **cheap(mesh=mesh))
np.savez(f"{folder}/folded-{process}.npz", value=folded())
"""


@pytest.mark.slow(reason="new processes that compile for themselves")
def test_two_processes_equal_one_bit_for_bit(tmp_path, on_one_device):
    pytest.importorskip("zarr")
    with socket.socket() as free:
        free.bind(("localhost", 0))
        address = f"localhost:{free.getsockname()[1]}"
    commands = [[*script(WORKER), str(process), address, tmp_path] for process in range(2)]
    workers = [subprocess.Popen(command, cwd=ROOT, env=environment(2)) for command in commands]
    try:
        assert [worker.wait() for worker in workers] == [0, 0]
    finally:
        for worker in workers:
            worker.kill()

    def found(name):
        return [dict(np.load(tmp_path / f"{name}-{process}.npz")) for process in range(2)]

    assert all(same(arrays, on_one_device) for arrays in found("gathered"))
    assert all(same(arrays, on_one_device) for arrays in found("stored"))
    first, second = (set(arrays["blocks"].tolist()) for arrays in found("written"))
    assert len(first) >= 2
    assert len(second) >= 2
    assert not first & second
    assert all(same(arrays, cheap()) for arrays in found("mesh"))
    assert all(arrays["value"] == folded() for arrays in found("folded"))


def test_arrays_of_all_kinds_are_packed_as_they_are(monkeypatch):
    """Without other processes: what one sends all receive."""
    from jax.experimental import multihost_utils

    monkeypatch.setattr(multihost_utils, "process_allgather", lambda x: np.stack([x, x]))
    mine = [np.array([True, False, True]), np.array([[-0.0, np.nan]]), np.array(7, np.int32)]
    forms = [jax.ShapeDtypeStruct(array.shape, array.dtype) for array in mine]
    both = Workers(processes=2).exchange(mine, [forms, forms[:2]])
    assert [len(arrays) for arrays in both] == [3, 2]
    for arrays in both:
        assert same(dict(enumerate(arrays)), dict(enumerate(mine[: len(arrays)])))


@pytest.mark.parametrize("axis", [AxisType.Auto, AxisType.Explicit])
def test_a_mesh_of_any_kind_will_do(axis):
    """A block is whole on one device, so that the names and kinds of axes have no meaning."""
    mesh = jax.make_mesh((1, 1), ("a", "b"), axis_types=(axis, axis))
    assert same(cheap(mesh=mesh), cheap())


def test_a_mesh_of_other_processes_is_refused(monkeypatch):
    monkeypatch.setattr(Mesh, "local_devices", property(lambda mesh: []))
    with pytest.raises(ValueError, match="but has none of process 0"):
        workers_of(jax.make_mesh((1,), ("lanes",), axis_types=(AxisType.Auto,)))


def test_arguments_are_put_where_the_block_is_computed():
    device = jax.devices()[0]
    workers = workers_of(Mesh(np.array([device]), ("lanes",)))
    assert workers.devices == (device,)
    (placed,) = workers.place(5, [np.arange(3.0)])
    assert placed.committed
    assert placed.devices() == {device}

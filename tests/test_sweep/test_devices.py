"""Lanes over several devices: no bit depends on how many there are."""

import os
import subprocess

import jax
import numpy as np
import pytest
from jax.sharding import AxisType, Mesh

from jaxcontact._sweep._devices import workers_of
from tests.test_sweep.lanes import ROOT, cheap, same, script

FOUR = """
mesh = jax.make_mesh((4,), ("lanes",), axis_types=(jax.sharding.AxisType.Auto,))

# Where the blocks were computed.
from jaxcontact._sweep._devices import Workers
used, placed = set(), Workers.placed
def seen(workers, turn, arguments):
    arrays = placed(workers, turn, arguments)
    used.update(device for array in arrays for device in array.devices())
    return arrays
Workers.placed = seen

np.savez(sys.argv[1], **swept(mesh=mesh))
assert len(used) == 4
"""


@pytest.mark.slow
def test_four_devices_equal_one_bit_for_bit(tmp_path, on_one_device):
    flags = f"{os.environ['XLA_FLAGS']} --xla_force_host_platform_device_count=4"
    subprocess.run(
        [*script(FOUR), tmp_path / "four.npz"],
        check=True,
        cwd=ROOT,
        env=os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"},
    )
    four = dict(np.load(tmp_path / "four.npz"))
    assert same(four, on_one_device)
    assert all(np.isfinite(values).all() for values in four.values())


@pytest.mark.parametrize("axis", [AxisType.Auto, AxisType.Explicit])
def test_a_mesh_of_any_kind_will_do(axis):
    """A block is whole on one device, so that the names and kinds of axes have no meaning."""
    mesh = jax.make_mesh((1, 1), ("a", "b"), axis_types=(axis, axis))
    assert same(cheap(mesh=mesh), cheap())


def test_what_is_no_mesh_is_refused():
    with pytest.raises(ValueError, match=r"Argument `mesh` must be a `jax.sharding.Mesh`"):
        workers_of(4)  # pyright: ignore[reportArgumentType]


def test_a_mesh_of_other_processes_is_refused(monkeypatch):
    monkeypatch.setattr(Mesh, "local_devices", property(lambda mesh: []))
    with pytest.raises(ValueError, match="but has none of process 0"):
        workers_of(jax.make_mesh((1,), ("lanes",), axis_types=(AxisType.Auto,)))


def test_arguments_are_put_where_the_block_is_computed():
    device = jax.devices()[0]
    workers = workers_of(Mesh(np.array([device]), ("lanes",)))
    assert workers.devices == (device,)
    (placed,) = workers.placed(5, [np.arange(3.0)])
    assert placed.committed
    assert placed.devices() == {device}

"""Devices of a mesh: all kinds are accepted; anything but a mesh of this process is refused."""

import jax
import numpy as np
import pytest
from jax.sharding import AxisType, Mesh

from jaxcontact._sweep.planning.blocks import workers_of
from tests.test_sweep.lanes import cheap, same


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
    (placed,) = workers.place(5, [np.arange(3.0)])
    assert placed.committed
    assert placed.devices() == {device}

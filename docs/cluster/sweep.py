"""A sweep on many processes: `srun python sweep.py STORE`, or `python sweep.py STORE` alone."""

import os
import sys

import jax

if "SLURM_JOB_ID" in os.environ:
    jax.distributed.initialize()  # first of all: before any array is made, a `Contact` too
jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp

import jaxcontact as jc

contact = jc.Contact(mass=1.0, stiffness=1.4e8, exponent=1.5)


def impact(e, v):
    return jc.impact(jc.HuGuo(e=e), contact, v)


def sweep(store=None):
    axes = {"e": jnp.linspace(0.05, 1, 96), "v": jnp.geomspace(0.01, 10, 200)}
    mesh = jax.sharding.Mesh(jax.local_devices(), ("lanes",))
    return jc.sweep(impact, **axes, batch_size=100, mesh=mesh, store=store)


if __name__ == "__main__":
    table = sweep(sys.argv[1])
    if jax.process_index() == 0:
        table.to_xarray().to_netcdf("sweep.nc")

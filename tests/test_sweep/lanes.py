"""A sweep with every method and a gradient, for tests that also compute it in other processes."""

import os
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc


def contact():
    # Created on demand, because JAX cannot become distributed after creating an array.
    return jc.Contact(mass=0.1, stiffness=1e7, exponent=1.5)


def durations(e, v):
    """By the three methods, with the gradient of the event solve."""

    def event(e, v):
        return jc.impact(jc.HuGuo(e=e), contact(), v, method="event").duration

    by_event, gradient = jax.value_and_grad(event, argnums=(0, 1))(e, v)
    return {
        "exact": jc.impact(jc.HuGuo(e=e), contact(), v, method="exact").duration,
        "phase": jc.impact(jc.HuGuo(e=e), contact(), v, method="phase").duration,
        "event": by_event,
        "by_e": gradient[0],
        "by_v": gradient[1],
    }


def swept(**how):
    """Eleven blocks, of which the last is short: no number of workers divides them."""
    samples = {"e": jnp.linspace(0.2, 0.95, 171), "v": jnp.geomspace(0.1, 9, 171)}
    table = jc.sweep(durations, samples=samples, batch_size=16, progress=False, **how)
    return arrays_of(table)


def outcome(e, v):
    """Of a cheap function, with flags and fields of several types."""
    return jc.impact(jc.HuGuo(e=e), contact(), v)


def cheap(**how):
    """A grid with an invalid lane."""
    e, v = jnp.linspace(0.0, 1, 13), jnp.linspace(0.0, 5, 7)
    table = jc.sweep(outcome, e=e, v=v, batch_size=10, progress=False, **how)
    return arrays_of(table)


def many(fn=outcome, *, v=None, batch_size=20, progress=False, **how):
    """The cheap function in some thirty blocks."""
    v = jnp.linspace(0.0, 4, 9) if v is None else v
    e = jnp.linspace(0.05, 1, 30)
    return jc.sweep(fn, e=e, v=v, batch_size=batch_size, progress=progress, **how)


def folded():
    """A sum whose last digits depend on the order of the blocks."""
    e = jnp.linspace(0.1, 1, 97)

    def add(total, block):
        return total + float(np.sum(block.duration))

    return jc.sweep(outcome, e=e, v=1.0, batch_size=10, reduce=(0.0, add), progress=False).value


def arrays_of(table):
    """The fields of a table that are arrays."""
    fields = {name: table[name] for name in table.fields}
    return {name: np.asarray(field) for name, field in fields.items() if np.ndim(field)}


def same(a, b):
    """Whether two dictionaries of arrays are equal bit for bit."""
    return a.keys() == b.keys() and all(
        a[k].dtype == b[k].dtype and a[k].shape == b[k].shape and a[k].tobytes() == b[k].tobytes()
        for k in a
    )


ROOT = Path(__file__).parents[2]


def environment(devices):
    """That of a process with several devices."""
    flags = f"{os.environ['XLA_FLAGS']} --xla_force_host_platform_device_count={devices}"
    return os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"}


def script(text):
    """The command line of a process that runs `text` in double precision, this module at hand."""
    head = """
import sys
import jax
jax.config.update("jax_enable_x64", True)
import numpy as np
from tests.test_sweep.lanes import *
"""
    return [sys.executable, "-c", head + text]

"""A sweep with every method and a gradient, for tests that also compute it in other processes."""

import os
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from jaxcontact._sweep.planning.axes import grid_of
from jaxcontact._sweep.planning.plan import plan_of
from jaxcontact._sweep.store import BlockStore


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


def digest_of(function):
    """What identifies a function of one number."""
    return plan_of(function, grid_of(None, {"x": [1.0]})).key.digest


def same_but_for_a_constant():
    """Functions of one number by name. Each differs from another in a constant, or in its place."""
    long = np.arange(3000.0)
    near = np.where(long == 1500, np.nextafter(1500, 0), long)  # A text would leave it out.
    constants = {
        **{repr(x): x for x in (0.1, float(np.nextafter(0.1, 1)), 0.0, -0.0, np.nan, 2, True)},
        **{repr(x): x for x in (np.float32(0.1), np.int32(2))},
        **{"pair": np.ones(2), "column": np.ones((2, 1)), "single": np.ones(2, np.float32)},
        **{"zeros": np.zeros(2), "negative": -np.zeros(2), "long": long, "near": near},
    }

    def plain(c):
        return lambda x: jnp.asarray(c) * jnp.asarray(x, jnp.result_type(c))

    def loop(c):
        return lambda x: jax.lax.fori_loop(0, 3, lambda _, y: jnp.sum(jnp.asarray(c) * y) + x, x)

    def branch(c):
        return lambda x: jax.lax.cond(x > 0, loop(c), jnp.sin, x)

    functions = {
        f"{kind.__name__} {name}": kind(c)
        for kind in (plain, loop, branch)
        for name, c in constants.items()
        if kind is plain or np.asarray(c).dtype == float
    }
    keys = {"0": jax.random.key(0), "1": jax.random.key(1)}
    # Keys with the same data.
    keys |= {impl: jax.random.key(0, impl=impl) for impl in ("rbg", "unsafe_rbg")}
    for name, key in keys.items():
        functions[f"random {name}"] = lambda x, key=key: (
            x + jax.random.normal(jax.random.fold_in(key, 3))
        )
    for law in (jc.HuGuo(e=0.5), jc.HuGuo(e=0.6), jc.Flores(e=0.5)):
        functions[repr(law)] = lambda x, law=law: jc.restitution(law, contact(), x)
    return functions


def digests():
    """Of all these functions, by name."""
    return {name: digest_of(function) for name, function in same_but_for_a_constant().items()}


def written_blocks(patch=setattr):
    """The numbers of the blocks that this process writes to stores from now on."""
    numbers, write = [], BlockStore.write

    def counted(store, number, arrays):
        numbers.append(number)
        write(store, number, arrays)

    patch(BlockStore, "write", counted)
    return numbers


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

"""Curves that several files fit: a line from zero, and decays to zero and to a level."""

import jax.numpy as jnp

FLAT = {"a": 0.0, "b": 0.0}


def line(p, x):
    return p["a"] + p["b"] * x


def fading(p, x):
    return p["a"] * jnp.exp(-p["b"] * x)


def decay(p, x):
    return fading(p, x) + p["c"]

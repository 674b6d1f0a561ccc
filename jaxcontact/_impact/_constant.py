"""Restitution that depends on neither the speed nor the contact."""

from __future__ import annotations

import collections
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._contact import Contact
from .._laws import AbstractLaw
from .._parameter import is_valid, sanitised


def restitution_is_constant(law: AbstractLaw, contact: Contact) -> bool:
    """Whether e is known to be the same at every speed: its form gives it without one."""
    try:
        return jax.eval_shape(lambda: law.form(contact, None).restitution()) is not None
    except (TypeError, ValueError):  # the law needs the speed
        return False


@functools.partial(jax.jit, static_argnums=0)
def restitutions(
    laws: tuple[Callable[..., AbstractLaw], ...], e: Float[Array, "laws n"]
) -> list[Float[Array, " n"] | None]:
    """The restitution that each law delivers for its own row of parameters e.

    None for a law whose restitution also depends on the contact or the speed; NaN where a parameter
    is out of range. Laws whose forms differ only in their numbers are solved together, since it
    takes longer to compile a solve than to run it.
    """
    groups: dict[Any, list[tuple[int, list[Array]]]] = collections.defaultdict(list)
    for k, made in enumerate(laws):
        try:
            law = made(e=e[k])
            form, good = sanitised(law).form(None, None).sound()
        except (TypeError, ValueError):  # the law needs the contact or the speed
            continue
        numbers, structure = jax.tree.flatten(form)
        columns = [jnp.broadcast_to(x, e[k].shape) for x in (*numbers, good & is_valid(law))]
        groups[structure].append((k, columns))
    delivered: list[Float[Array, " n"] | None] = [None] * len(laws)
    for structure, members in groups.items():
        places, columns = zip(*members, strict=True)
        *numbers, good = map(jnp.stack, zip(*columns, strict=True))
        found = jax.tree.unflatten(structure, numbers).restitution()
        if found is not None:
            for k, row in zip(places, jnp.where(good, found, jnp.nan), strict=True):
                delivered[k] = row
    return delivered

"""Inputs of `impact`, `restitution` and `trajectory`: checks, conversion, scaling."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from .._contact import EXPONENT, Contact, require_contact
from .._entry import Range, Specialised, as_number, is_plain, is_valid, require_broadcast, sanitised
from .._forms import AbstractForm, HuntCrossleyForm, Scale, SpeedDependentForm, scale_of
from .._laws import VELOCITY_THRESHOLD, AbstractLaw, require_exponent, require_law
from .motion.ending import NeckMotion, PlasticMotion
from .motion.motion import Motion

SPEED = Range(low=VELOCITY_THRESHOLD, inside=1.0)
FORCE = Range(inside=0.0)


class Problem(NamedTuple):
    """An impact as given; `lanes_of` converts it to one precision and rank."""

    law: AbstractLaw
    contact: Contact
    velocity: float | Float[Array, "..."]
    external_force: float | Float[Array, "..."] | None

    @property
    def shape(self) -> tuple[int, ...]:
        """The broadcast shape of all inputs."""
        return np.broadcast_shapes(*map(np.shape, jax.tree.leaves(self)))


def problem_of(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    external_force: ArrayLike | None = None,
) -> Problem:
    """Check the arguments as far as possible without reading arrays. Raises ValueError if an
    argument is not a law, contact or number, and for a Python or NumPy scalar out of range. It also
    raises it for an exponent that the law does not support, and for shapes that do not broadcast.
    """
    require_law(law)
    require_contact(contact)
    push = None
    if external_force is not None:
        push = as_number(external_force, "external_force", FORCE)
        if is_plain(external_force) and external_force == 0:
            push = None
    require_exponent(law, contact)
    speed = as_number(velocity, "velocity", SPEED)
    require_broadcast(law=law, contact=contact, velocity=speed, external_force=push)
    return Problem(law, contact.normal, speed, push)


def uniform(tree: Any) -> Any:
    """Return `tree` with all numbers in the highest precision among them, and of one rank."""
    # A Python number in a law is data: a new value must not trigger a compilation.
    tree = jax.tree.map(lambda x: jnp.asarray(float(x)) if type(x) in (float, int) else x, tree)
    leaves = [leaf for leaf in jax.tree.leaves(tree) if eqx.is_inexact_array(leaf)]
    # A Python number is weakly typed and follows the arrays. Without arrays it has the default
    # precision.
    strong = [leaf.dtype for leaf in leaves if not leaf.weak_type]
    # Fitted numbers are double. If x64 is disabled they are used in single precision.
    dtype = jax.dtypes.canonicalize_dtype(max(strong, key=lambda d: d.itemsize, default=float))
    rank = max((leaf.ndim for leaf in leaves), default=0)

    def convert(leaf: Any) -> Any:
        if not eqx.is_inexact_array(leaf):
            return leaf
        if 0 < leaf.ndim < rank:
            leaf = leaf.reshape((1,) * (rank - leaf.ndim) + leaf.shape)
        return jax.lax.convert_element_type(leaf, dtype)

    return jax.tree.map(convert, tree)


class Lanes(eqx.Module):
    """A problem in scaled units, with a mask of its valid lanes.

    `form`, the exponent `n`, the external force `push` (None if there is none) and the `scale` are
    not broadcast. A number equal in all lanes stays a scalar. `shape` is that of the problem.
    `peak`: whether damping refers to the largest closing speed since touch.
    """

    form: AbstractForm
    exponent: Specialised
    push: Float[Array, "..."] | None
    scale: Scale
    valid: Bool[Array, "..."]
    shape: tuple[int, ...] = eqx.field(static=True)
    peak: bool = eqx.field(static=True, default=False)

    @property
    def n(self) -> float | Float[Array, "..."]:
        """The exponent; a float if it is concrete."""
        return self.exponent.value

    @property
    def knows_no_damping(self) -> bool:
        """True if the damping of the force is not known to be dissipative."""
        return self.form.damping(self.n, jnp.asarray(True)) is None

    @property
    def may_gain(self) -> bool:
        """True if an impact may end faster than it began, without an external force."""
        return self.push is None and self.knows_no_damping

    def motion(self) -> Motion:
        """Return the equation of motion of the lanes, for methods that solve one lane."""
        # XLA would constant-fold a solve without inputs, such as Hertz's law, which takes forty
        # seconds. A barrier for each number avoids tangents for numbers that have none.
        numbers = (self.form, self.exponent, self.push)
        form, exponent, push = jax.tree.map(jax.lax.optimization_barrier, numbers)
        kind = NeckMotion if form.ends_apart else Motion
        if form.remembers and not form.tension:
            kind = PlasticMotion
        return kind(form, exponent, push, peak=self.peak)


def lanes_of(problem: Problem, peak: bool = False, speeds: Range = SPEED) -> Lanes:
    """Return the scaled problem, with valid numbers in place of invalid input.

    `peak`: whether damping refers to the largest closing speed since touch. An external force makes
    it larger than the speed at touch. It matters for the Hunt-Crossley family. `speeds` is the
    valid range of closing speeds.
    """
    problem = uniform(problem)
    contact = problem.contact
    n = contact.exponent
    valid = is_valid(problem.law) & is_valid(contact) & speeds.holds(problem.velocity)
    if not isinstance(n, float):
        good = EXPONENT.holds(n)
        if problem.law.exponents is not None:
            good = good & jnp.any(jnp.stack([n == e for e in problem.law.exponents]), axis=0)
        valid = valid & good
        contact = eqx.tree_at(
            lambda c: c._exponent.traced, contact, jnp.where(good, n, EXPONENT.inside)
        )
    push = problem.external_force
    if push is not None:
        valid = valid & FORCE.holds(push)
        push = jnp.where(FORCE.holds(push), push, 0)
    contact = sanitised(contact)
    velocity = jnp.where(speeds.holds(problem.velocity), problem.velocity, speeds.inside)
    scale = scale_of(contact, velocity)
    law = sanitised(problem.law)
    form, good_form = law.form(contact, scale).sound()
    peak = peak and push is not None and law.refers_to_peak
    if peak and not is_known(lambda law: law.damping_factor(None, None), law):
        alpha = cast(HuntCrossleyForm, form).alpha
        form = SpeedDependentForm(
            alpha=alpha, tension=law.tension, law=law, contact=contact, scale=scale
        )
    return Lanes(
        form=form,
        exponent=contact._exponent,
        push=None if push is None else push / scale.force,
        scale=scale,
        valid=valid & good_form,
        shape=problem.shape,
        peak=peak,
    )


def is_known(number: Callable[[AbstractLaw], Any], law: AbstractLaw) -> bool:
    """Return whether a law has a number of this kind, without the arguments that it lacks here."""
    try:
        return jax.eval_shape(number, law) is not None
    except (TypeError, ValueError):  # the law needs the speed
        return False

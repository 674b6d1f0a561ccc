"""Inputs of impacts, normal and oblique: checks, conversion, scaling."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from .._contact import EXPONENT, Contact, require_contact
from .._entry import (
    REAL,
    Range,
    Specialised,
    as_number,
    is_list,
    is_plain,
    is_valid,
    refusal,
    require_broadcast,
    sanitised,
    static_value,
)
from .._forms import AbstractForm, HuntCrossleyForm, Scale, scale_of
from .._friction import AbstractFriction
from .._friction.base import Tangential, require_friction
from .._laws import (
    VELOCITY_THRESHOLD,
    AbstractLaw,
    SpeedDependentForm,
    require_exponent,
    require_law,
)
from .derivatives import common_shape
from .motion.equation import Motion, NeckMotion, PlasticMotion
from .oblique.bodies import NamedShape, RoundBodies, require_bodies
from .result import Status

SPEED = Range(low=VELOCITY_THRESHOLD, inside=1.0)


class Problem(NamedTuple):
    """An impact as given; `lanes_of` converts it to one precision and rank."""

    law: AbstractLaw
    contact: Contact
    velocity: float | Float[Array, "..."]
    external_force: float | Float[Array, "..."] | None

    @property
    def shape(self) -> tuple[int, ...]:
        """The broadcast shape of all inputs."""
        return common_shape(self)


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
        push = as_number(external_force, "external_force", REAL)
        if is_plain(external_force) and external_force == 0:
            push = None
    require_exponent(law, contact)
    speed = as_number(velocity, "velocity", SPEED)
    require_broadcast(law=law, contact=contact, velocity=speed, external_force=push)
    return Problem(law, contact.normal, speed, push)


class ObliqueProblem(NamedTuple):
    """An oblique impact as given. Numbers are leaves."""

    problem: Problem
    friction: AbstractFriction
    bodies: RoundBodies | NamedShape
    ratio: Float[Array, "..."] | None
    velocity: float | Float[Array, "..."]
    spin: tuple[float | Float[Array, "..."], float | Float[Array, "..."]]


def oblique_problem_of(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    tangential_velocity: ArrayLike,
    friction: Any,
    bodies: Any,
    spin: Any,
) -> ObliqueProblem:
    """Check the arguments as far as possible without reading arrays; ValueError for a bad one."""
    problem = problem_of(law, contact, velocity)
    require_friction(friction)
    round_bodies = require_bodies(bodies)
    if isinstance(round_bodies, RoundBodies):
        round_bodies.require_mass(contact.mass)
    slip = as_number(tangential_velocity, "tangential_velocity", REAL)
    spins = _spins(spin, len(round_bodies.radii))
    require_broadcast(
        law=law,
        contact=contact,
        velocity=problem.velocity,
        tangential_velocity=slip,
        friction=friction,
        bodies=round_bodies,
        spin=spins,
    )
    return ObliqueProblem(problem, friction, round_bodies, contact.tangential_ratio, slip, spins)


def _spins(spin: Any, turning: int) -> tuple[Any, Any]:
    """Return both spins as numbers; ValueError if one is of a body that has no radius."""
    if not is_list(spin) or len(spin) != 2:
        raise refusal("spin", "be two numbers (ω1, ω2)", spin)
    first, second = (as_number(one, "spin", REAL) for one in spin)
    for k, one in enumerate((first, second)):
        if k >= turning and static_value(one) != 0:
            needs = "`bodies` with radii" if turning == 0 else "`other_radius` of the bodies"
            raise refusal("spin", f"be 0 for ω{k + 1} without {needs}", spin)
    return first, second


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

    def status(
        self, e: Array, most: float, settled: Array | bool, solved: Array
    ) -> Int[Array, "..."]:
        """Return the status of all lanes. An e above `most` without a push is a gain of energy."""
        parted = int(Status.SEPARATED)
        if self.push is None and self.knows_no_damping:
            parted = jnp.where(e > most, int(Status.GAINED), parted)
        status = jnp.where(settled, int(Status.SETTLED), parted)
        status = jnp.where(solved, status, int(Status.NOT_CONVERGED))
        status = jnp.where(self.valid, status, int(Status.INVALID_INPUT))
        return jnp.broadcast_to(status, self.shape)

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
        valid = valid & REAL.holds(push)
        push = jnp.where(REAL.holds(push), push, 0)
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


class SlidingStart(NamedTuple):
    """The tangential motion at touch, in SI units, with valid numbers in place of invalid input.

    `slip` is that of the contact point, and `sign` its sign; `mobility` is λ, `arms` are R/I of the
    bodies that turn, and `mass` is the effective one. `valid` marks valid input.
    """

    velocity: Float[Array, "..."]
    spins: list[Float[Array, "..."]]
    slip: Float[Array, "..."]
    sign: Float[Array, "..."]
    mobility: Float[Array, "..."]
    arms: list[Float[Array, "..."]]
    mass: Float[Array, "..."]
    valid: Bool[Array, "..."]

    def problem(self, lanes: Lanes, e: Array, ratio: Array | None) -> Tangential:
        """Return the problem in scaled units, for the restitution e of the normal motion."""
        return Tangential(
            slip=self.sign * self.slip / lanes.scale.speed,
            mobility=self.mobility,
            restitution=e,
            alpha=lanes.form.hysteresis_factor,
            exponent=lanes.n,
            ratio=ratio,
            speed=lanes.scale.speed,
        )


def sliding_of(given: ObliqueProblem) -> SlidingStart:
    """Return the tangential motion of numbers of one precision and rank."""
    numbers = (given.velocity, *given.spin)
    valid = is_valid(given.friction) & is_valid(given.bodies)
    for number in numbers:
        valid = valid & REAL.holds(number)
    velocity, *spins = (jnp.where(REAL.holds(x), x, 0) for x in numbers)
    mass, bodies = sanitised(given.problem.contact).mass, sanitised(given.bodies)
    slip = velocity
    for radius, spin in zip(bodies.radii, spins, strict=False):
        slip = slip + radius * spin
    sign = jnp.where(slip < 0, -1, 1).astype(slip.dtype)
    return SlidingStart(
        velocity, spins, slip, sign, bodies.mobility(mass), bodies.arms(mass), mass, valid
    )


def sliding_problem(
    law: AbstractLaw,
    contact: Contact,
    velocity: ArrayLike,
    tangential_velocity: ArrayLike,
    friction: AbstractFriction,
    bodies: Any,
    e: Array,
) -> tuple[AbstractFriction, SlidingStart, Tangential]:
    """Return the friction law, and the tangential motion of impacts without spin: at touch, and as
    a scaled problem. `e` is the restitution of the normal motion.
    """
    speeds = law, contact, velocity, tangential_velocity
    given = uniform(oblique_problem_of(*speeds, friction, bodies, (0.0, 0.0)))
    sliding = sliding_of(given)
    return given.friction, sliding, sliding.problem(lanes_of(given.problem), e, given.ratio)

"""What a law does within a time step of an engine, on the contact pairs of its state."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
from jaxtyping import Array, Float

from ... import AbstractLaw, Contact, WetRestitution
from ...extend import (
    force_of,
    ranges,
    refusal,
    require_contact,
    require_count,
    require_exponent,
    require_law,
)

PerPair = Float[Array, " pairs"]

_ROOT = 3
"""Newton's steps to the root of a cubic, at the end of a contact that pulls."""


class Gaps(NamedTuple):
    """Pairs of bodies at the start of a step.

    Indentations are in m, negative where the bodies are apart. Closing speeds are in m/s, and
    closing accelerations in m/s² are those without these contacts. `yields` (pairs, pairs) in 1/kg
    has the opening acceleration of each pair by the force on each.
    """

    depth: PerPair
    speed: PerPair
    acceleration: PerPair
    yields: Float[Array, "pairs pairs"]


class Push(NamedTuple):
    """What the forces F of a step from 0 to h do: ∫F dt in N s, ∫(h - t)F dt in N s², and the
    closing speeds v0 in m/s that the contacts remember.
    """

    impulse: PerPair
    shift: PerPair
    touch_speed: PerPair


class StepMotion(NamedTuple):
    """Indentations, closing speeds, and what the forces have done since the start of the step."""

    depth: PerPair
    speed: PerPair
    push: Push


def require_steppable(law: object) -> AbstractLaw:
    """Return a law whose force follows from its v0; raise ValueError for any other."""
    law = require_law(law)
    # Slow bodies of a wet law stick, although its force lets them go.
    if law.remembers or law.forgets or law.ends_apart or isinstance(law, WetRestitution):
        must = "be a law without memory inside another engine, and not one of necks or films"
        raise refusal("law", must, law, " `simulate` takes it.")
    return law


def require_per_pair(law: AbstractLaw, contact: Contact, count: int, pairs: str) -> None:
    """Raise ValueError for a number of the law or the contact that is not one, or one a pair."""
    numbers = {f"law.{name}": getattr(law, name) for name in ranges(law)}
    numbers |= {f"contact.{x}": getattr(contact, x) for x in ("stiffness", "exponent")}
    for name, number in numbers.items():
        if jnp.shape(number) not in ((), (1,), (count,)):
            raise ValueError(
                f"Argument `{name}` must be one number, or have one for each of the {count} "
                f"{pairs}, but has the shape {jnp.shape(number)}."
            )


def push_of(
    law: AbstractLaw,
    contact: Contact,
    gaps: Gaps,
    touch_speed: PerPair,
    duration: Float[Array, ""],
    substeps: int,
) -> Push:
    """Follow the pairs through a time step, in `substeps` steps of Runge and Kutta's order 4.

    δ'' = a - Y F(δ, δ', v0), with the accelerations a and the matrix Y of the start. A contact
    begins inside a substep, where the parabola of its flight ends, and takes v0 there. The result
    is therefore a continuous function of the state, whatever substep holds the touch. The effective
    mass of the law is 1/Y_kk.
    """
    length = duration / substeps

    def advance(now: StepMotion, _: None) -> tuple[StepMotion, None]:
        return substep(law, contact, gaps, now, length), None

    return jax.lax.scan(advance, start_of(gaps, touch_speed), None, length=substeps)[0].push


def start_of(gaps: Gaps, touch_speed: PerPair) -> StepMotion:
    """Return the motion at the start of a step."""
    still = jnp.zeros_like(gaps.depth)
    return StepMotion(gaps.depth, gaps.speed, Push(still, still, touch_speed))


def substep(
    law: AbstractLaw,
    contact: Contact,
    gaps: Gaps,
    now: StepMotion,
    length: PerPair | Float[Array, ""],
) -> StepMotion:
    """Return the motion after one substep of this length in s."""
    depth, speed, (impulse, shift, touch_speed) = now
    # Bodies that cannot move have no effective mass, and no force either.
    free = jnp.diagonal(gaps.yields)
    contact = eqx.tree_at(lambda c: c.mass, contact.normal, 1 / jnp.where(free > 0, free, 1))
    wait, at_touch = _touch(depth, speed, gaps.acceleration, length)
    open_ = depth < 0
    touch_speed = jnp.where(open_ & (wait < length), at_touch, touch_speed)

    def refers(speed: PerPair) -> PerPair:
        """Return v0: the largest closing speed since touch, if the law has one."""
        return jnp.maximum(touch_speed, speed) if law.refers_to_peak else touch_speed

    def flight(t: PerPair | Float[Array, ""]) -> tuple[PerPair, PerPair]:
        a = gaps.acceleration
        return depth + t * (speed + t * a / 2), speed + t * a

    def pushes(window: PerPair) -> tuple[PerPair, PerPair]:
        """Return ∫F dt and ∫(end - t)F dt from the touch over a window of each pair."""

        def force(part: float, lost: PerPair, slowed: PerPair) -> PerPair:
            free_depth, free_speed = flight(wait + part * window)
            inside = jnp.maximum(free_depth - gaps.yields @ lost, 0)
            now_speed = free_speed - gaps.yields @ slowed
            return force_of(law, inside, now_speed, contact, refers(now_speed))

        none = jnp.zeros_like(window)
        f1 = force(0, none, none)
        f2 = force(0.5, none, window * f1 / 2)
        f3 = force(0.5, window**2 * f1 / 4, window * f2 / 2)
        f4 = force(1, window**2 * f2 / 2, window * f3)
        return window * (f1 + 2 * (f2 + f3) + f4) / 6, window**2 * (f1 + f2 + f3) / 6

    window = length - wait
    gained, lag = pushes(window)
    if law.tension:
        # The force jumps where the contact ends, so that the window must end there.
        ends, end_speed = flight(length)
        ends, end_speed = ends - gaps.yields @ lag, end_speed - gaps.yields @ gained
        begins, begin_speed = flight(wait)
        part = _exit(jnp.maximum(begins, 0), begin_speed * window, ends, end_speed * window)
        window = part * window
        gained, lag = pushes(window)
        lag = lag + gained * (length - wait - window)
    free_depth, free_speed = flight(length)
    return StepMotion(
        free_depth - gaps.yields @ lag,
        free_speed - gaps.yields @ gained,
        Push(
            impulse + gained,
            shift + impulse * length + lag,
            jnp.where(open_, touch_speed, refers(speed)),
        ),
    )


def _touch(
    depth: PerPair, speed: PerPair, acceleration: PerPair, length: PerPair | Float[Array, ""]
) -> tuple[PerPair, PerPair]:
    """Return the time until each pair touches, at most `length`, and its closing speed then."""
    squared = speed**2 - 2 * acceleration * depth
    # The root has an infinite slope at zero, where a pair only just touches.
    reaches = (depth < 0) & (squared > 0)
    at_touch = jnp.sqrt(jnp.where(reaches, squared, 1))
    toward = speed + at_touch
    reaches = reaches & (toward > 0)
    wait = -2 * depth / jnp.where(reaches, toward, 1)
    return jnp.where(depth < 0, jnp.where(reaches & (wait < length), wait, length), 0), at_touch


def _exit(begin: PerPair, begin_rate: PerPair, end: PerPair, end_rate: PerPair) -> PerPair:
    """Return the part of a window after which its cubic falls to zero; 1 if it ends above."""
    leaves = (end < 0) & (end_rate < 0)
    a = begin_rate + end_rate - 2 * (end - begin)
    b = 3 * (end - begin) - 2 * begin_rate - end_rate

    part = jnp.ones_like(end)
    for _ in range(_ROOT):
        value = begin + part * (begin_rate + part * (b + part * a))
        slope = begin_rate + part * (2 * b + 3 * part * a)
        part = jnp.clip(part - value / jnp.where(leaves & (slope < 0), slope, -1), 0, 1)
    return jnp.where(leaves, part, 1)


class EnginePairs(NamedTuple):
    """The pairs of a state, and the velocities that a unit impulse on each pair adds."""

    gaps: Gaps
    answers: Float[Array, "nv pairs"]


class Action(NamedTuple):
    """What the law does in a step: the mean forces in N, and the velocities times s by which the
    positions have to move after the engine's step. `touch_speed` is to be carried.
    """

    force: PerPair
    shift: Float[Array, " nv"]
    touch_speed: PerPair


def pairs_of(
    depth: PerPair,
    speed: PerPair,
    acceleration: PerPair,
    jacobian: Float[Array, "pairs nv"],
    mass: Float[Array, "nv nv"],
) -> EnginePairs:
    """Return the pairs of a state, by the derivatives of closing speeds by velocities."""
    answers = jax.scipy.linalg.solve(mass, jacobian.T, assume_a="pos")
    return EnginePairs(Gaps(depth, speed, acceleration, jacobian @ answers), answers)


def first_speeds(pairs: EnginePairs) -> PerPair:
    """Return the v0 of a start: bodies that overlap touch with their speed."""
    return jnp.where(pairs.gaps.depth > 0, jnp.maximum(pairs.gaps.speed, 0), 0)


class LawInside(NamedTuple):
    """A law in the steps of an engine."""

    law: AbstractLaw
    contact: Contact
    substeps: int

    def act(
        self, pairs: EnginePairs, touch_speed: PerPair, step: Float[Array, ""], part: float
    ) -> Action:
        """Follow the contacts through a step of an engine.

        The engine moves a body of constant acceleration a by h v + `part` h² a: 1 in semi-implicit
        steps, ½ in those of Runge and Kutta.
        """
        gaps = pairs.gaps
        # Such a body is on an exact parabola, on which its speed is that of another time.
        gaps = gaps._replace(speed=gaps.speed + (part - 0.5) * step * gaps.acceleration)
        push = push_of(self.law, self.contact, gaps, touch_speed, step, self.substeps)
        # The engine moves the bodies as if the mean force had acted all the time.
        shift = pairs.answers @ (part * step * push.impulse - push.shift)
        return Action(push.impulse / step, shift, push.touch_speed)


def law_inside(law: AbstractLaw, contact: Contact, substeps: int) -> LawInside:
    """Return a law that can act inside of an engine; ValueError for any other, and bad numbers."""
    require_exponent(require_steppable(law), require_contact(contact))
    return LawInside(law, contact, require_count("substeps", substeps, 1))


def require_same(model: Any, own: Any) -> None:
    """Raise ValueError for another model, which may have the engine's contacts beside the law's."""
    if jax.tree.structure(model) != jax.tree.structure(own):
        raise ValueError(
            "Argument `model` must be the `model` of this object, with any numbers, but is "
            f"another {type(model).__name__}."
        )


def numbers_of(
    parts: str, given: Sequence[str] | None, names: Sequence[str | None]
) -> Sequence[int]:
    """Return the numbers of the given names of `parts` (geoms, links), or all; ValueError for
    others.
    """
    if given is None:
        return range(len(names))
    known = not isinstance(given, str) and all(x in names for x in given)
    if not known or not given:
        raise refusal(parts, f"be a list of names of {parts} of the model", given)
    return [names.index(name) for name in given]


@contextlib.contextmanager
def relaxed() -> Iterator[None]:
    """Engines mix precisions and shapes, which a user's settings may forbid."""
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        yield

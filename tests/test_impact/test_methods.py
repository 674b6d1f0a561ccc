"""Method objects: options, names, and a method defined outside the package."""

from typing import ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._impact import method_of

CONTACT = jc.Contact(0.7, 3e8)
LAW = jc.HuGuo(e=0.6)


@pytest.mark.parametrize("name", ["exact", "phase", "event"])
def test_a_name_is_short_for_the_object(name):
    objects = {"exact": jc.Exact(), "phase": jc.Phase(steps=32), "event": jc.Event(max_steps=256)}
    assert method_of(name) == objects[name] == method_of(objects[name])
    by_name = jc.impact(LAW, CONTACT, 1.3, method=name)
    by_object = jc.impact(LAW, CONTACT, 1.3, method=objects[name])
    assert by_name.method == by_object.method == name
    assert eqx.tree_equal(by_name, by_object)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: jc.Event(rtol=1.0), ["rtol", "(0, 1)", "1.0"]),
        (lambda: jax.jit(lambda x: jc.Event(rtol=x).rtol)(0.1), ["rtol", "(0, 1)", "Tracer"]),
        (lambda: jc.Event(max_steps=1), ["max_steps", "whole", "1"]),
        (lambda: jc.Phase(steps=7), ["steps", "even", "7"]),
        (lambda: jc.trajectory(LAW, CONTACT, 1.0, method="exact"), ["'event'", "'exact'"]),
        (lambda: jc.trajectory(LAW, CONTACT, 1.0, method=jc.Phase()), ["'event'", "Phase("]),
    ],
)
def test_what_is_refused(make, words):
    with pytest.raises(ValueError, match="Argument `") as caught:
        make()
    for word in words:
        assert word in str(caught.value)


class Static(eqx.Module):
    """A method as a choice, and one as a part of a tree."""

    choice: jc.AbstractMethod = eqx.field(static=True)
    part: jc.AbstractMethod


def test_methods_are_static_fields_and_parts_of_trees():
    traces = []

    @eqx.filter_jit
    def solve(how, event, e):
        traces.append(event.choice.rtol + event.part.rtol)
        law = jc.HuGuo(e=e)
        return [jc.impact(law, CONTACT, 1.3, method=m).duration for m in (how.choice, how.part)]

    def make():
        event = jc.Event(rtol=1e-6, solver=diffrax.Tsit5())
        return Static(jc.Phase(16), jc.Exact()), Static(event, event)

    by_phase, by_formula = solve(*make(), jnp.asarray(0.5))
    solve(*make(), jnp.asarray(0.7))
    assert traces == [2e-6]
    assert {jc.Event(rtol=1e-6), jc.Event(rtol=np.float64(1e-6))} == {jc.Event(rtol=1e-6)}
    assert jc.Event(rtol=1e-6) != jc.Event(rtol=1e-7)
    assert repr(jc.Event()) == "Event() by the library's own loop with Dopri8's coefficients"
    assert repr(make()[1].choice).endswith("solver=Tsit5()) by diffrax.diffeqsolve with Tsit5")
    by_adjoint = jc.Event(adjoint=diffrax.ForwardMode())
    assert by_adjoint.solved_by == "diffrax.diffeqsolve with Dopri8"
    exact = jc.impact(jc.HuGuo(e=0.5), CONTACT, 1.3).duration
    np.testing.assert_allclose([by_phase, by_formula], exact, rtol=1e-6)
    plain = jax.jit(lambda how: jc.impact(LAW, CONTACT, 1.3, method=how).restitution)(jc.Exact())
    # Two programs, which may differ by one rounding.
    np.testing.assert_allclose(plain, jc.restitution(LAW), rtol=3e-16)


class Classical(jc.AbstractMethod):
    """The method of Runge and Kutta in steps of equal time, written by a user."""

    step: float = eqx.field(static=True)
    name: ClassVar[str] = "classical"

    def chosen(self, form, pushed):
        return self

    def solve(self, lanes):
        alpha, n = lanes.form.alpha, lanes.n
        push = 0.0 if lanes.push is None else lanes.push
        h, yes = self.step, jnp.asarray(True)

        def rate(x, v):
            return v, push - lanes.form.force(jnp.maximum(x, 0), v, n, yes)

        def advance(state, _):
            x, v = state
            a, b = rate(x, v)
            c, d = rate(x + h / 2 * a, v + h / 2 * b)
            e, f = rate(x + h / 2 * c, v + h / 2 * d)
            g, k = rate(x + h * e, v + h * f)
            after = x + h / 6 * (a + 2 * c + 2 * e + g), v + h / 6 * (b + 2 * d + 2 * f + k)
            return after, (*state, rate(*state)[1])

        touch = jnp.zeros_like(alpha), jnp.ones_like(alpha)
        x, v, rates = jax.lax.scan(advance, touch, length=int(6 / h))[1]
        inside = jax.lax.cummin((x >= 0).astype(int), axis=0) == 1
        last = jnp.sum(inside, axis=0) - 1
        x_last, v_last = (jnp.take_along_axis(y, last[None], 0)[0] for y in (x, v))
        force = jnp.where(inside, push - rates, 0)
        return jc.ScaledImpact(
            restitution=-v_last,
            duration=h * last.astype(x.dtype) - x_last / v_last,
            compression_time=h * jnp.sum((v > 0) & inside, axis=0, dtype=x.dtype),
            max_indentation=jnp.max(x, axis=0),
            max_force=jnp.max(force, axis=0),
        )


# Two steps of h, the error of its crude ends.
CRUDE = 3e-3


@pytest.mark.slow(reason="a solver of the user's own: its programs are its own")
@pytest.mark.parametrize("force", [None, 100.0])
def test_a_method_of_the_users(force):
    law, how = jc.HuGuo(e=jnp.array([0.5, 0.7, 0.9])), Classical(step=1e-3)
    hit = jc.impact(law, CONTACT, 1.3, method=how, external_force=force)
    known = jc.impact(law, CONTACT, 1.3, external_force=force)
    assert hit.method == "classical" and known.method != "classical"
    for name in ("restitution", "duration", "compression_time", "max_indentation", "max_force"):
        np.testing.assert_allclose(getattr(hit, name), getattr(known, name), rtol=CRUDE)
    if force is None:
        e = jc.restitution(law, CONTACT, 1.3, method=how)
        np.testing.assert_array_equal(e, hit.restitution)
        run = jc.bounce(law, CONTACT, 0.1, method=how, bounces=2)
        np.testing.assert_allclose(run.restitution[:, 0], hit.restitution, rtol=CRUDE)

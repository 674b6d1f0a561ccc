"""Spring-sliders by event solves and along a trajectory, beside their phases."""

import functools

import jax
import numpy as np
import pytest

import jaxcontact as jc

EVENT = 1e-9  # of ψ2; the default tolerance. Measured: 1.5e-11 (force), 4e-10 (others)
PATH = 2e-5  # of the slip at touch, with 200 samples. Measured: 1.7e-5

RATIO, DRAW = 0.8, np.random.default_rng(5)
SLIPS = np.concatenate([[0.02, 0.3], DRAW.uniform(0, 7, 30)])
CONTACT = jc.Contact(mass=1.0, stiffness=1.0, exponent=1.5)


def hits(form, **how):
    friction = jc.SpringSlider(1.0, RATIO, form)
    return jc.oblique_impact(jc.Damped(alpha=0.3), CONTACT, 1.0, SLIPS, friction=friction, **how)


@functools.cache
def by_event():
    """Slip velocities of the form "force" and their slopes, by one program: as `hits`, and beside
    the slip from which an undamped contact slides at touch.
    """

    def after(slip, alpha):
        given = jc.Damped(alpha), CONTACT, 1.0, slip
        hit = jc.oblique_impact(*given, friction=jc.SpringSlider(1.0, RATIO), method="event")
        return hit.slip_velocity, (hit.slip, hit.ok)

    near = (1 + np.array([-1e-7, 1e-7])) / RATIO
    slips, alpha = np.append(SLIPS, near), np.append(np.full(SLIPS.size, 0.3), [0.0, 0.0])
    program = jax.jit(jax.vmap(jax.value_and_grad(after, has_aux=True)))
    return jax.tree.map(np.asarray, program(slips, alpha))


@pytest.mark.parametrize("form", ["force", "rescaled"])
def test_event_solves_agree_with_phases(form):
    # Slips near full sliding end with both rates near zero, where an end may be missed.
    phase = hits(form)
    if form == "force":
        (after, (slip, ok)), _ = by_event()
        after, slip = after[:-2], slip[:-2]
    else:
        event = hits(form, method="event")
        after, slip, ok = event.slip_velocity, event.slip, event.ok
    assert ok.all() and phase.ok.all()
    error = RATIO * np.abs(np.array(after - phase.slip_velocity))
    assert error.max() < EVENT
    assert np.array_equal(slip, phase.slip)


def test_slopes_of_event_solves_are_continuous_at_touch():
    near = by_event()[1][-2:]
    assert near[0] == pytest.approx(near[1], abs=2e-3)


@pytest.mark.parametrize("form", ["force", "displacement", "rescaled"])
def test_a_trajectory_ends_at_the_outcome(form):
    friction = jc.SpringSlider(1.0, RATIO, form)
    path = jc.oblique_trajectory(jc.Damped(alpha=0.3), CONTACT, 1.0, SLIPS, friction=friction)
    error = np.array(path.slip_velocity[:, -1] - hits(form).slip_velocity)
    assert (np.abs(error) / np.maximum(SLIPS, 1)).max() < PATH
    assert (np.abs(path.friction) <= path.force * (1 + 1e-12)).all()


def test_a_row_of_springs_along_a_trajectory_ends_at_the_table():
    friction = jc.MawBarberFawcett(1.0, RATIO)
    given = jc.Damped(alpha=0.3), CONTACT, 1.0, SLIPS
    path = jc.oblique_trajectory(*given, friction=friction)
    hit = jc.oblique_impact(*given, friction=friction)
    error = np.array(path.slip_velocity[:, -1] - hit.slip_velocity)
    assert (np.abs(error) / np.maximum(SLIPS, 1)).max() < PATH


def test_any_normal_law_is_followed():
    # Beside a linear spring all forms are the same, and strong friction sticks but for the end.
    contact = jc.Contact(mass=1.0, stiffness=1.0, exponent=1.0)
    hit = jc.oblique_impact(jc.Hertz(), contact, 1.0, 0.01, friction=jc.SpringSlider(50.0, 0.5))
    assert hit.method == "event" and hit.ok
    # u'' = -λ κ u during the half period π. The spring slips in the last 1e-4 of it.
    wanted = 0.01 * np.cos(np.sqrt(3.5 * 0.5) * np.pi)
    assert float(hit.slip_velocity) == pytest.approx(wanted, abs=1e-6)

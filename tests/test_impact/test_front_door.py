"""The entry points `impact` and `restitution`: accepted, flagged and refused input."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_impact.support import impacts

CONTACT = jc.Contact(0.7, 3e8)
LAW = jc.Damped(alpha=1.0)
# At this exponent the law of Kuwabara and Kono has no closed form.
SOFTER = jc.Contact(0.7, 3e8, 2.0)
NUMBERS = (
    "restitution rebound_velocity duration compression_time max_indentation max_force energy_loss"
).split()


def lane(hit, index):
    return jax.tree.map(lambda leaf: leaf[index], hit)


# --- Flagged --------------------------------------------------------------------------------------


def test_bad_exponents_are_flagged():
    n = np.array([1.5, 0.9, 3.1, np.nan, 2.0, np.inf])
    hit = impacts(LAW, jc.Contact(0.7, 3e8, n), 1.3)
    assert (hit.status == [0, 3, 3, 3, 0, 3]).all()
    alone = impacts(LAW, jc.Contact(0.7, 3e8, 2.0), 1.3)
    assert np.isclose(hit.duration[4], alone.duration, rtol=1e-13, atol=0)
    n[4] = 1
    linear = impacts(jc.KelvinVoigt(e=0.6), jc.Contact(0.7, 3e8, n), 1.3)
    assert (linear.status == [3, 3, 3, 3, 0, 3]).all()


class Negative(jc.AbstractHuntCrossley):
    """A user's law whose α is not always one."""

    alpha: jax.Array

    def damping_factor(self, contact=None, velocity=None):
        return self.alpha


def test_a_damping_factor_of_the_users_is_checked():
    hit = impacts(Negative(np.array([0.3, -0.1, np.nan, np.inf])), CONTACT, 1.3)
    assert (hit.status == [0, 3, 3, 3]).all()


# --- What raises ----------------------------------------------------------------------------------


def by(method, law=LAW, contact=CONTACT, **push):
    return lambda: jc.impact(law, contact, 1.0, method=method, **push)


LINEAR = jc.Contact(0.7, 3e8, 1.0)
LUDING = jc.Luding(ratio=1.5, slope=0.0, adhesion=0.3)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: jc.impact(LAW, CONTACT, -1.0), ["velocity", "-1.0", "[1e-09, inf)"]),
        (lambda: jc.impact(jc.KelvinVoigt(e=0.5), CONTACT, 1.0), ["contact", "exponent 1", "1.5"]),
        (lambda: jc.impact(jc.Tsuji(e=0.5), LINEAR, 1.0), ["1.5", "Tsuji"]),
        (by("exact", external_force=9.8), ["method", "'event'", "external force"]),
        (by("exact", jc.KuwabaraKono(A=1e-6), SOFTER), ["method", "'event'", "closed form"]),
        (by("phase", jc.Thornton(e=0.5)), ["method", "'event'", "clamped"]),
        (by("phase", external_force=1.0), ["method", "'event'", "external force"]),
        # The phase angle follows a contact to δ = 0, on the curve of its way in.
        (by("phase", jc.JKR(pull_off=0.1)), ["`method` must be"]),
        (by("phase", LUDING, LINEAR), ["`method` must be"]),
        (by("phase", jc.WaltonBraun(ratio=2.0, slope=0.0), LINEAR), ["must be 'event'"]),
        (lambda: jc.JKR(pull_off=0.1, tension=False), ["`tension` must be True for `JKR`"]),
        (lambda: jc.Luding(1.5, 0.0, 0.3, tension=False), ["`tension` must be True for `Luding`"]),
        (
            lambda: jc.ThorntonPlastic(yield_speed=0.1).force(1e-3, 0.0, LINEAR, 1.0),
            ["must have the exponent 1.5 for `ThorntonPlastic`"],
        ),
        (lambda: jc.trajectory(LAW, CONTACT, 1.0, samples=1), ["samples", "1"]),
        (lambda: jc.trajectory(LAW, CONTACT, 1.0, method="exact"), ["'event'", "'exact'"]),
        (lambda: jc.trajectory(LAW, CONTACT, 1.0, method=jc.Phase()), ["'event'", "Phase("]),
        (lambda: jax.jit(lambda x: jc.Event(rtol=x).rtol)(0.1), ["rtol", "(0, 1)", "Tracer"]),
        (lambda: jc.Phase(steps=7), ["steps", "even", "7"]),
        (lambda: jc.restitution(jc.ConstantDamping(c=1.0)), ["contact", "ConstantDamping"]),
        (lambda: jc.restitution(jc.ConstantDamping(c=1.0), CONTACT), ["velocity"]),
        (lambda: jc.restitution(jc.MarhefkaOrin(a=1.0)), ["velocity", "MarhefkaOrin"]),
        (lambda: jc.restitution(jc.KuwabaraKono(A=1e-6)), ["contact", "KuwabaraKono"]),
    ],
)
def test_scalars_out_of_range_raise(make, words):
    with pytest.raises(ValueError, match="Argument `") as caught:
        make()
    for word in words:
        assert word in str(caught.value)


# --- Options --------------------------------------------------------------------------------------

SAME_STEPS = 1e-12  # two orders of the same steps; measured 4e-15 and 6e-14
ADJOINT = 1e-7  # a derivative through the steps, at rtol 1e-11; measured 3e-10


@pytest.mark.slow(reason="two adjoints of an event solve")
def test_an_adjoint_of_the_users_agrees_with_the_default():
    def duration(adjoint, **options):
        how = jc.Event(rtol=1e-11, adjoint=adjoint, **options)
        return lambda e: jc.impact(jc.HuGuo(e=e), CONTACT, 1.3, method=how).duration

    e = jnp.array(0.6)
    default = jax.jit(jax.value_and_grad(duration(None)))(e)
    exact = jax.grad(lambda e: jc.impact(jc.HuGuo(e=e), CONTACT, 1.3).duration)(e)
    backwards = jax.jit(jax.value_and_grad(duration(diffrax.RecursiveCheckpointAdjoint())))(e)
    given = duration(diffrax.DirectAdjoint(), max_steps=64)
    direct = jax.jit(lambda e: jax.jvp(given, (e,), (jnp.ones_like(e),)))(e)
    for value, slope in (default, backwards, direct):
        assert np.isclose(value, default[0], rtol=SAME_STEPS, atol=0)
        assert np.isclose(slope, exact, rtol=ADJOINT, atol=0)


def test_no_external_force_is_the_free_path():
    free = jc.impact(LAW, CONTACT, 1.3)
    for none in (None, 0, 0.0):
        hit = jc.impact(LAW, CONTACT, 1.3, external_force=none)
        assert hit.method == "exact" and eqx.tree_equal(hit, free)


@pytest.mark.parametrize("method", ["exact", "event"])
def test_shapes_broadcast(method):
    law = jc.Damped(alpha=jnp.array([[1.5], [0.6], [0.2]]))
    hit = jc.impact(law, CONTACT, jnp.array([1.0, 2.0, 3.0, 4.0]), method=method)
    leaves = [leaf for leaf in jax.tree.leaves(hit) if eqx.is_array(leaf)]
    assert len(leaves) >= len(NUMBERS) + 1
    assert all(leaf.shape == (3, 4) for leaf in leaves)
    one = impacts(jc.Damped(alpha=0.6), CONTACT, 3.0, method=method)
    for f in NUMBERS:
        # Vector code rounds differently (measured 4e-16), which changes adaptive steps.
        rtol = 1e-8 if method == "event" else 1e-12
        assert np.isclose(getattr(hit, f)[1, 2], getattr(one, f), rtol=rtol, atol=0), f
    assert np.ptp(hit.restitution, axis=1).max() == 0


def test_the_summary_reads_well():
    hit = impacts(LAW, CONTACT, np.array([1.3, -1.0]))
    text = repr(lane(hit, 0))
    assert text.startswith("Impact by method 'exact'\n") and "separated" in text and "m/s" in text
    assert "1 separated, 1 invalid_input" in repr(hit)
    assert "shape" in repr(lane(hit, slice(1, 2)))
    jax.eval_shape(lambda v: repr(jc.impact(LAW, CONTACT, v)) and v, 1.0)


# --- Restitution alone ----------------------------------------------------------------------------

ASKED = jnp.array([0.9, 0.7, 0.5, 0.3, 0.1])


@pytest.mark.parametrize(("dtype", "largest"), [(np.float64, 153), (np.float32, 18)])
def test_extreme_damping_delivers_its_inverse(dtype, largest):
    """α e = 1 up to e^-α, with derivative -1/α², up to where α² overflows."""
    alpha = jnp.asarray(10.0 ** np.linspace(1.9, largest, 500), dtype)
    e, slope = jax.jvp(lambda a: jc.restitution(jc.Damped(alpha=a)), (alpha,), (alpha,))
    rounding = 4 * np.finfo(dtype).eps
    assert np.allclose(e * alpha, 1, rtol=rounding, atol=0)
    assert np.allclose(slope, -e, rtol=rounding, atol=0)


def test_bad_lanes_and_shapes_of_restitution():
    e = jc.restitution(jc.HuGuo(e=jnp.array([0.5, -1.0, np.nan, 1.0])))
    assert np.array_equal(np.isnan(e), [False, True, True, False]) and e[3] == 1
    grid_ = jc.restitution(jc.HuGuo(e=ASKED[:, None]), CONTACT, jnp.ones(3))
    assert grid_.shape == (5, 3)


@pytest.mark.parametrize("law", [jc.HuGuo, jc.AntypovElliott])
def test_no_time_is_computed(law):
    def program(function):
        """The operations of what XLA makes of it."""
        return jax.jit(function).lower(jnp.array(0.5)).compile().cost_analysis()["flops"]

    def here(e):
        return jc.restitution(law(e=e), CONTACT, 1.0)

    alone = program(lambda e: jc.restitution(law(e=e)))
    whole = program(lambda e: jc.impact(law(e=e), CONTACT, 1.0).duration)
    # The scale and the checks of a contact cost a little. One node of the integral costs more, but
    # is in a loop, which is counted once.
    assert program(here) <= alone + 50 < whole


def test_only_what_alpha_depends_on_is_needed():
    velocity = jnp.array([0.1, 1.0, 10.0, -1.0])
    slowing = jc.restitution(jc.ConstantDamping(c=3e7), CONTACT, velocity)
    marhefka = jc.restitution(jc.MarhefkaOrin(a=0.1), velocity=velocity)
    for e, alpha in ((slowing, velocity * (3e7 / 3e8)), (marhefka, 0.15 * velocity)):
        same = jc.restitution(jc.Damped(alpha=alpha))
        assert np.allclose(e[:3], same[:3], rtol=1e-15, atol=0) and np.isnan(e[3])
    of_n = jc.restitution(jc.EnergyLoss(0.5, 2.0), contact=CONTACT)
    assert of_n == pytest.approx(float(jc.restitution(jc.EnergyLoss(0.5, 2.0))), rel=1e-14)

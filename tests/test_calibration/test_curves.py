"""The curves e(v; θ): against other means, and what of a law and a contact they depend on."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcontact._calibration import Curve, choose_curves
from jaxcontact._calibration._curves import evaluate
from jaxcontact._calibration._viscous import STRONGEST, viscous_restitution
from jaxcontact._contact import Contact
from jaxcontact._impact import restitution
from jaxcontact._laws import ConstantDamping, KuwabaraKono, constant_laws
from tests.test_calibration import oracle

ORACLE = 1e-7
"""Against integration at 1e-10 with a spline of 25 nodes, whose error it is: measured 1e-8."""

SOLVE = 1e-8
"""The polynomial against the solve it stands for, rtol 1e-9: measured 1.3e-9."""

SLOPE = 1e-6
"""Central differences with step 1e-5: measured 1e-9."""

SPEEDS = np.geomspace(0.05, 5.0, 40)


@pytest.mark.parametrize(("kind", "value"), [("kuwabara_kono", 0.07), ("constant_damping", 0.08)])
def test_curves_are_those_of_the_law(kind, value):
    e, _ = evaluate(Curve(kind, kind), jnp.log(jnp.array([value])), jnp.asarray(SPEEDS))
    expected = [getattr(oracle, kind)(value)(v) for v in SPEEDS]
    np.testing.assert_allclose(e, expected, rtol=ORACLE)


@pytest.mark.parametrize("curve", choose_curves(None), ids=lambda curve: curve.kind)
def test_slope_and_start(curve):
    theta = curve.start(0.88, 1.5)
    e, slope = evaluate(curve, theta, jnp.asarray(SPEEDS))
    high, _ = evaluate(curve, theta + 1e-5, jnp.asarray(SPEEDS))
    low, _ = evaluate(curve, theta - 1e-5, jnp.asarray(SPEEDS))
    np.testing.assert_allclose(slope, (high - low) / 2e-5, rtol=SLOPE)
    # The start is made from approximations; it only has to be near.
    assert abs(float(np.interp(1.5, SPEEDS, e)) - 0.88) < 0.02


def of_any_contact(seed, number):
    """Random parameters (60,) whose identified combination, `number`(p), is in a good range."""
    rng = np.random.default_rng(seed)
    names = {"law": (0, 0), "K": (4, 10), "m": (-4, 1), "v": (-2, 1)}
    p = {name: 10 ** rng.uniform(*powers, 60) for name, powers in names.items()}
    # The law's own parameter makes up for the others.
    p["law"] *= rng.uniform(0.005, 1.9, 60) / number(p)
    return {name: jnp.asarray(value) for name, value in p.items()}


def test_kuwabara_kono_knows_one_combination():
    p = of_any_contact(1, lambda p: p["law"] * (p["K"] / p["m"]) ** 0.4 * p["v"] ** 0.2)
    solved = restitution(KuwabaraKono(A=p["law"]), Contact(p["m"], p["K"], 1.5), p["v"])
    strength = p["law"] * (p["K"] / p["m"]) ** 0.4 * p["v"] ** 0.2
    np.testing.assert_allclose(viscous_restitution(strength), solved, rtol=SOLVE)


def test_constant_damping_knows_one_combination():
    p = of_any_contact(2, lambda p: p["law"] / p["K"] * p["v"])
    law = ConstantDamping(c=p["law"])
    solved = restitution(law, Contact(p["m"], p["K"], 1.5), p["v"])
    curve = Curve("constant_damping", "constant_damping")
    b = p["law"] / p["K"]
    curved = jnp.stack([curve.restitution(jnp.log(b[k : k + 1]), p["v"][k]) for k in range(3)])
    np.testing.assert_allclose(curved, solved[:3], rtol=1e-12)


def test_the_polynomial_ends_well():
    np.testing.assert_allclose(viscous_restitution(jnp.zeros(1)), 1.0, rtol=SOLVE)
    # Beyond its range it stands still, and says so by its derivative.
    assert jax.grad(viscous_restitution)(1.5 * STRONGEST) == 0


def test_choice_of_curves():
    assert [c.kind for c in choose_curves(None)] == [
        "constant",
        "kuwabara_kono",
        "constant_damping",
    ]
    assert [c.law for c in choose_curves("kuwabara_kono")] == ["exact", "kuwabara_kono"]
    assert [c.law for c in choose_curves("constant_damping")] == ["exact", "constant_damping"]
    assert choose_curves("hu_guo")[0].law == "hu_guo"
    assert "hu_guo" in constant_laws()
    assert not {"damped", "hertz", "energy_loss", "constant_damping"} & set(constant_laws())
    for bad in ("nonsense", "damped"):
        with pytest.raises(ValueError, match=f"must be one of exact.*{bad}|must be one of.*{bad}"):
            choose_curves(bad)

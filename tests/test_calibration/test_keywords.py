"""Ready-made fits: law, contact, then data; the keywords of `fit` by their names."""

import inspect

import numpy as np
import pytest

import jaxcontact as jc

LAW, CONTACT, V, E = jc.HuGuo(e=0.8), jc.Contact(0.1, 1e6), np.linspace(1, 2, 6), np.full(6, 0.8)
FRICTION = jc.RigidCoulomb(0.2)
READY = (
    *(jc.choose_friction, jc.choose_law, jc.fit_bounces, jc.fit_damping, jc.fit_energy_loss),
    *(jc.fit_impacts, jc.fit_oblique, jc.fit_record, jc.learn_law),
)
OF_FIT = inspect.signature(jc.fit).parameters
CHOICES = {jc.choose_law: set(), jc.choose_friction: {"groups", "weights"}}
OWN_SIGMA = {*CHOICES, jc.fit_impacts, jc.fit_oblique, jc.fit_record}
OWN_NOISE = {jc.choose_friction, jc.fit_oblique, jc.fit_record}
LEFT = {"predict", "data", "start", "x"}


@pytest.mark.parametrize("function", READY)
def test_signatures_show_what_fit_takes(function):
    shown = inspect.signature(function).parameters
    assert all(one.kind is not one.VAR_KEYWORD for one in shown.values())
    missing = OF_FIT.keys() - shown.keys() - LEFT - ({"sigma"} if function in OWN_SIGMA else set())
    # A choice fits many laws: one that fails is flagged.
    of_one = {"correlation", "transforms", "throw"}
    assert missing == (of_one | CHOICES[function] if function in CHOICES else set())
    for name in OF_FIT.keys() & shown.keys() - LEFT:
        own = name == "noise" and function in OWN_NOISE
        wanted = None if own else OF_FIT[name].default
        assert shown[name].default == wanted and shown[name].kind is inspect.Parameter.KEYWORD_ONLY


@pytest.mark.parametrize("function", READY)
def test_an_unknown_keyword_fails_by_name(function):
    wrong = rf"`{function.__name__}` has no argument `strats`\. Did you mean 'starts'\?"
    with pytest.raises(TypeError, match=wrong):
        function(strats=3)


OLD_ORDERS = {
    "choose_law": (lambda: jc.choose_law(V, E, CONTACT), "contact"),
    "fit_damping": (lambda: jc.fit_damping(V, E, CONTACT), "contact"),
    "fit_record": (lambda: jc.fit_record(V, LAW, CONTACT, 1.0, force=E), "law"),
    "fit_impacts": (lambda: jc.fit_impacts(V, LAW, CONTACT, e=E), "law"),
    "fit_oblique": (lambda: jc.fit_oblique(V, V, LAW, CONTACT, friction=FRICTION), "law"),
    "choose_friction": (lambda: jc.choose_friction(CONTACT, LAW, V, V), "law"),
    "fit_bounces": (lambda: jc.fit_bounces(CONTACT, LAW, V, E), "law"),
    "design": (lambda: jc.design(CONTACT, LAW, sigma={"e": 0.1}, candidates=V), "law"),
    "fit_energy_loss": (lambda: jc.fit_energy_loss(CONTACT, V), "e_in"),
    "learn_law": (lambda: jc.learn_law(V / 2, CONTACT), "e_out"),
    "velocity": (lambda: jc.choose_law(CONTACT, CONTACT, E), "velocity"),
    "time": (lambda: jc.fit_record(LAW, CONTACT, 1.0, V, force=E), "velocity"),
    "impact": (lambda: jc.impact(CONTACT, LAW, 1.0), "law"),
    "trajectory": (lambda: jc.trajectory(CONTACT, LAW, 1.0), "law"),
    "restitution": (lambda: jc.restitution(LAW, 1.0, CONTACT), "contact"),
    "bounce": (lambda: jc.bounce(LAW, 1.0, CONTACT), "contact"),
    "export": (lambda: jc.export(LAW, 1.0, CONTACT, engine="mujoco"), "contact"),
    "plot.law": (lambda: jc.plot.law(CONTACT, LAW, 1.0), "law"),
}


@pytest.mark.parametrize("call", OLD_ORDERS)
def test_another_order_fails_by_name(call):
    function, name = OLD_ORDERS[call]
    with pytest.raises(ValueError, match=f"Argument `{name}` must "):
        function()


def test_a_transform_beside_that_of_beta():
    with pytest.raises(ValueError, match=r"must not name what this problem .* but names beta"):
        jc.fit_energy_loss(E, transforms={"beta": jc.Free()})

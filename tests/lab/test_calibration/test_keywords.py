"""Ready-made fits: law, contact, then data; the keywords of `fit` by their names."""

import inspect

import pytest

import jaxcontact as jc

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

"""Laws by name, and user-defined laws."""

import jax
import jax.numpy as jnp
import pytest

import jaxcontact as jc
from jaxcontact._laws import describe, force_of
from jaxcontact._laws import registry as _registry
from tests.test_impact.test_new_form import Plain

CONTACT = jc.Contact(mass=0.2, stiffness=1e8)


@pytest.fixture(autouse=True)
def registry_as_it_was(monkeypatch):
    monkeypatch.setattr(_registry, "_REGISTRY", dict(_registry._REGISTRY))


def test_get_law():
    law = jc.get_law("hu_guo", e=0.7)
    assert type(law) is jc.HuGuo and law.e == 0.7 and law.tension is False
    assert jc.get_law("hu_guo", e=0.7, tension=True).tension is True
    with pytest.raises(TypeError, match="alpha"):
        jc.get_law("hu_guo", alpha=0.7)


def test_describe():
    known = describe("hu_guo")
    assert known.cls is jc.HuGuo
    assert known.formula == "3(1-e)/(2e)"
    assert "10.1007/s11044-015-9453-z" in known.source
    assert known.valid
    assert all(describe(name).source and describe(name).formula for name in jc.list_laws())


def test_a_name_is_held_by_one_class():
    with pytest.raises(ValueError, match="'hu_guo' already names `HuGuo`"):

        @jc.register_law("hu_guo")
        class Other(jc.AbstractHuntCrossley):
            def damping_factor(self, contact=None, velocity=None):
                return jnp.asarray(0.0)

    assert describe("hu_guo").cls is jc.HuGuo


def test_a_cell_may_be_run_twice():
    def cell(value):
        @jc.register_law("mine", formula=f"{value}")
        class Mine(jc.AbstractHuntCrossley):
            def damping_factor(self, contact=None, velocity=None):
                return jnp.asarray(value)

        return Mine

    first, second = cell(0.1), cell(0.2)
    assert first is not second
    assert describe("mine").cls is type(jc.get_law("mine")) is second
    assert describe("mine").formula == "0.2"
    jc.list_laws().clear()  # a copy
    assert jc.list_laws().count("mine") == 1
    assert jc.list_laws()[-1] == "mine"


def test_laws_are_abstract_or_final():
    with pytest.raises(TypeError, match="abstract"):
        jc.AbstractLaw()
    with pytest.raises(TypeError, match="abstract"):
        jc.AbstractHuntCrossley()


# --- A law of one's own --------------------------------------------------------------------------


def test_a_law_says_whether_it_pulls():
    words = "Law `Silent` must set `tension` in the class. False: .* True: "
    with pytest.raises(TypeError, match=words):

        class Silent(jc.AbstractLaw):
            def force(self, indentation, velocity, contact, impact_velocity):
                return indentation

    with pytest.raises(ValueError, match="`tension` must be True or False, but is 'no'"):

        class Odd(jc.AbstractLaw):
            tension = "no"

    class Base(jc.AbstractLaw):
        """Without a force: a law of some kind, which may say it for all."""

        c: float

    class Pushes(Base):
        tension: bool = False

        def force(self, indentation, velocity, contact, impact_velocity):
            return self.c * indentation

    class Pulls(Pushes):
        tension = True

    class Inherits(Pulls):
        pass

    made = [kind(2.0) for kind in (Pushes, Pulls, Inherits)]
    assert [law.tension for law in made] == [False, True, True]
    assert Pulls(2.0, tension=False).tension is False
    assert jax.tree.leaves(made[0]) == [2.0]  # static, keyword only
    assert "tension" not in repr(Pushes(2.0))
    assert repr(Pulls(2.0, tension=False)).endswith(", tension=False)")


def test_a_pull_of_an_unclamped_force_counts_as_none():
    for tension in (False, True):
        law = Plain(5e3, tension=tension)
        force = force_of(law, 1e-6, jnp.array([-1e3, 1.0]), CONTACT, 1.0)
        assert force[1] > 0 and (force[0] < 0 if tension else force[0] == 0)


def test_what_is_misspelt_is_told_with_a_suggestion():
    with pytest.raises(ValueError, match=r"but is 'Hu_Gou'\. Did you mean 'hu_guo'\?"):
        jc.get_law("Hu_Gou", e=0.5)
    with pytest.raises(ValueError, match="`name` must be one of") as caught:
        jc.get_law("abc", e=0.7)
    assert all(known in str(caught.value) for known in jc.list_laws())
    with pytest.raises(TypeError, match=r"power_damping has no parameter 'powr'; .*'power'\?"):
        jc.get_law("power_damping", c=1.0, powr=1.0, reference=1.0)
    with pytest.raises(ValueError, match=r"but is 'kuwabara'\. Did you mean 'kuwabara_kono'\?"):
        jc.calibrate(jc.read_recording(), laws="kuwabara")

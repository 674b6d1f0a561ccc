"""Equality of functions: by what they compute, wherever and whenever they were written."""

import dataclasses
import functools
import importlib
import re
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._sweep.planning.key import NoKey, key_of

scale = 2.0


def scaled(e):
    return scale * e


def through_another(e):
    return scaled(e) + 1


def recursive(n):
    return n if n < 1 else recursive(n - 1) * scale


class Law(jc.AbstractLaw):
    """Whose method reads a global."""

    stiffness: float = 3.0
    tension = False

    def force(self, indentation, velocity, contact, impact_velocity):
        return scale * self.stiffness * indentation


@dataclasses.dataclass
class Settings:
    factor: object


class Counter:
    __slots__ = ("count",)

    def __init__(self, count):
        self.count = count

    def __call__(self, e):
        return self.count * e


def keeps(value):
    return lambda e: (value, e)


def _kind(value):
    return type(value).__name__


def typed_once():
    return lambda e, v: jc.impact(jc.HuGuo(e=e), jc.Contact(1.0, 1e8), v)


def typed_again():
    return lambda e, v: jc.impact(jc.HuGuo(e=e), jc.Contact(1.0, 1e8), v)


def test_a_function_typed_again_is_the_same():
    assert key_of(typed_once()) == key_of(typed_again())
    assert hash(key_of(typed_once())) == hash(key_of(typed_again()))
    assert key_of(lambda e: e + 1) != key_of(lambda e: e + 2)
    assert key_of(lambda e: -e) != key_of(lambda e: +e)
    assert key_of(lambda e, f=1: e) != key_of(lambda e, f=2: e)
    assert key_of(lambda e, *, f=1: e) != key_of(lambda e, *, f=2: e)
    assert key_of(lambda e: (lambda: e + 1)()) != key_of(lambda e: (lambda: e + 2)())


@pytest.mark.parametrize(
    "function",
    [
        *(scaled, through_another, recursive, Law().force, Law(), Law),
        *(lambda e: scaled(e), lambda e: (lambda: scale * e)()),
        *(functools.partial(scaled, 1.0), jax.vmap(scaled), jax.grad(scaled), jax.jit(scaled)),
        *(Settings(scaled), [scaled], {"a": (scaled,)}, keeps(scaled), functools.cache(scaled)),
    ],
    ids=_kind,
)
def test_a_global_that_is_read_counts(function, monkeypatch):
    before = key_of(function)
    assert key_of(function) == before
    monkeypatch.setattr(sys.modules[__name__], "scale", 3.0)
    assert key_of(function) != before
    monkeypatch.setattr(sys.modules[__name__], "scale", 2.0)
    assert key_of(function) == before


def test_a_global_that_is_not_read_does_not_count(monkeypatch):
    before = key_of(recursive)
    monkeypatch.setattr(sys.modules[__name__], "Counter", None)
    assert key_of(recursive) == before


def test_a_module_of_the_users_own(tmp_path, monkeypatch):
    """Also one that the function imports itself, and a module beside it that it reads."""
    (tmp_path / "own_numbers.py").write_text("factor = 2.0\nother = 1.0\n")
    (tmp_path / "own_laws.py").write_text(
        "import own_numbers\ndef law(e):\n    return own_numbers.factor * e\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    own_laws, own_numbers = map(importlib.import_module, ("own_laws", "own_numbers"))

    def outside(e):
        return own_laws.law(e)

    def inside(e):
        import own_laws

        return own_laws.law(e)

    def named(e):
        from own_laws import law

        return law(e)

    functions = [outside, inside, named, own_laws.law]
    before = [key_of(function) for function in functions]
    own_numbers.other = 5.0
    assert [key_of(function) for function in functions] == before
    own_numbers.factor = 5.0
    assert all(map(lambda a, b: a != b, [key_of(f) for f in functions], before))


DIFFERENT = [
    *(None, True, 1, 1.0, np.float64(1.0), np.float32(1.0), np.int64(1), "1", b"1", 1j, (1,), [1]),
    *(0.0, -0.0, np.nan, np.float64(-0.0), {}, {"a": 1}, {"a": 2}, {1}, frozenset({1}), range(1)),
    *(np.zeros(2), -np.zeros(2), np.zeros((2, 1)), np.zeros(2, np.float32), jnp.zeros(2)),
    *(jax.random.key(0), jax.random.key(1), jax.random.key(0, impl="rbg"), np.dtype("f4")),
    *(jc.HuGuo(e=0.5), jc.HuGuo(e=0.6), jc.Flores(e=0.5), jc.Event(rtol=1e-9), jc.Event(rtol=1e-8)),
    *(jc.Status.SEPARATED, jc.Status.SETTLED, Counter(1), Counter(2), Settings(1), Settings(2)),
    *(Settings([1]), np.sin, jnp.sin, "a".upper, "b".upper, len, float, jnp.float32, object()),
    *(jax.lax.Precision.HIGHEST, slice, scaled, recursive, jax.nn.relu, eqx.Module, ...),
]


def test_what_a_closure_holds_counts_by_its_content():
    keys = [key_of(keeps(value)) for value in DIFFERENT]
    assert len(set(keys)) == len(keys)
    assert keys == [key_of(keeps(value)) for value in DIFFERENT]
    # Equal, though different objects.
    assert key_of(keeps(np.arange(3))) == key_of(keeps(np.arange(3)))
    assert key_of(keeps(jc.HuGuo(e=0.5))) == key_of(keeps(jc.HuGuo(e=0.5)))
    assert key_of(keeps(Counter([1, 2.0]))) == key_of(keeps(Counter([1, 2.0])))


def test_a_cell_that_changes():
    factor = 2.0

    def function(e):
        return factor * e

    before = key_of(function)
    factor = 3.0
    assert key_of(function) != before


@pytest.mark.parametrize(
    "hidden", [iter([1]), np.random.default_rng(0), re.compile("a"), np.array([None])], ids=_kind
)
def test_a_state_that_cannot_be_seen_has_no_key(hidden):
    with pytest.raises(NoKey):
        key_of(keeps(hidden))
    with pytest.raises(NoKey):
        key_of(keeps({"deep": [hidden]}))


def test_too_much_to_look_at_has_no_key():
    with pytest.raises(NoKey, match="too many"):
        key_of(keeps([[k] for k in range(20_000)]))


def test_sweeps_follow_what_changes():
    """The same through the front door: the numbers are those of now."""
    numbers = {"factor": 2.0}
    factor = 1.0

    def function(e, flag):
        return factor * numbers["factor"] * e * (3 if flag is True else 1)

    def swept(flag=1):
        return jc.sweep(function, e=[1.0], flag=flag).value[0]

    assert swept() == 2
    numbers["factor"] = 5.0
    assert swept() == 5
    factor = 2.0
    assert swept() == 10
    assert swept(True) == 30 and swept(1) == 10


def test_the_kind_of_random_numbers_counts():
    def function(e):
        return e + jax.random.normal(jax.random.key(0))

    def swept():
        return jc.sweep(function, e=[0.0]).value[0]

    usual = swept()
    with jax.default_prng_impl("rbg"):
        other = swept()
    assert other != usual == swept()


def test_a_function_with_a_hidden_state_is_traced_each_time():
    values = iter([1.0, 2.0])
    for expected in (1.0, 2.0):
        assert jc.sweep(lambda e: e * next(values), e=[1.0]).value[0] == expected

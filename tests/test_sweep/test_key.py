"""Equality of functions: by the program that JAX traces, in every process."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_sweep.lanes import digest_of, digests, same_but_for_a_constant


def test_another_constant_is_another_program():
    found = digests()
    assert len(set(found.values())) == len(found)
    again = {name: digest_of(function) for name, function in same_but_for_a_constant().items()}
    assert again == found


def test_a_function_typed_again_is_the_same():
    assert digest_of(lambda x: jnp.sin(2 * x)) == digest_of(lambda x: jnp.sin(2 * x))
    assert digest_of(lambda x: jnp.sin(2 * x)) != digest_of(lambda x: jnp.sin(x * 2))
    with jax.enable_x64(False):
        single = digest_of(lambda x: jnp.sin(2 * x))
    assert digest_of(lambda x: jnp.sin(2 * x)) != single

    def random(x):
        return x + jax.random.normal(jax.random.key(0))

    usual = digest_of(random)
    with jax.default_prng_impl("rbg"):
        other = digest_of(random)
    assert other != usual == digest_of(random)


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


@dataclasses.dataclass(eq=False)
class Times:
    """Its text does not tell the factor."""

    factor: float = dataclasses.field(repr=False)

    def __call__(self, x):
        return self.factor * x


@pytest.mark.parametrize("inside", [False, True], ids=["plain", "in a loop"])
def test_what_calls_back_to_python_is_compiled_each_time(inside):
    """The text of a program has the name of the Python function only."""

    def swept(factor):
        def call(x):
            return jax.pure_callback(Times(factor), jax.ShapeDtypeStruct((), x.dtype), x)

        def function(e):
            return jax.lax.fori_loop(0, 2, lambda _, x: call(x), e) if inside else call(e)

        return jc.sweep(function, e=1.0).value

    power = 2 if inside else 1
    assert [swept(factor) for factor in (2.0, 3.0, 2.0)] == [2.0**power, 3.0**power, 2.0**power]


def test_a_store_warns_of_what_calls_back_to_python(tmp_path):
    pytest.importorskip("zarr")

    def function(e):
        return jax.pure_callback(np.sin, jax.ShapeDtypeStruct((), e.dtype), e)

    with pytest.warns(UserWarning, match="`fn` calls back to Python, whose code a store does not"):
        table = jc.sweep(function, e=1.0, store=tmp_path / "sweep.zarr")
    assert table.value == np.sin(1.0)

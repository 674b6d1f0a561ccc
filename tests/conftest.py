"""What holds for every test: double precision, strict arrays, repeatable examples, no windows."""

import os

# Before matplotlib is imported by anything: no display is needed or touched.
os.environ.setdefault("MPLBACKEND", "Agg")
# The suite must compile what it tests. A cache on disk would hide a change of XLA and outlive a
# run.
os.environ["JAX_ENABLE_COMPILATION_CACHE"] = "false"

import jax
import pytest
from hypothesis import HealthCheck, settings

# The library sets none of these: they belong to whoever runs it.
jax.config.update("jax_enable_x64", True)
# An accidental float32 or a missing axis should fail here, not lose digits in silence.
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

settings.register_profile(
    "jaxcontact",
    derandomize=True,
    # The first example pays for compilation.
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("jaxcontact")


@pytest.fixture
def usual_promotion():
    """The promotion that users have, for calls into libraries that do not keep the strict one.

    optax's Adam raises a float to an integer count; diffrax's event solve mixes float32 states with
    float64 times.
    """
    with jax.numpy_dtype_promotion("standard"):
        yield

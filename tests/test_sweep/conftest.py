import jax
import pytest

from tests.test_sweep import lanes


@pytest.fixture(scope="session")
def on_one_device():
    """All methods and a gradient, computed here."""
    with jax.default_device(jax.devices("cpu")[0]):
        return lanes.swept()

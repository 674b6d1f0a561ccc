import jax
import pytest

from tests.test_sweep import lanes


@pytest.fixture(scope="session")
def on_one_device():
    """By formula, by steps and with a gradient, computed here."""
    with jax.default_device(jax.devices("cpu")[0]):
        return lanes.swept()

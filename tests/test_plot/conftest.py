import pytest
from matplotlib import pyplot


@pytest.fixture(autouse=True)
def close():
    """Every test closes the figures that it opened."""
    yield
    pyplot.close("all")

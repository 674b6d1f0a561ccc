"""docs/engines.md shows what its code prints."""

import contextlib
import io

import jax
import numpy as np
import pytest

from docs.run_code import BLOCK, DOCS

pytestmark = pytest.mark.engines

PRINTED = 1e-3
"""Of the numbers of the page, which other versions of the engines may change."""


@pytest.mark.parametrize(("engine", "module"), [("mjx", "mujoco.mjx"), ("jaxsim", "jaxsim")])
def test_the_code_of_the_page(engine, module):
    pytest.importorskip(module)
    page = (DOCS / "engines.md").read_text(encoding="utf-8")
    (block,) = (m for m in BLOCK.finditer(page) if f"{engine}.contact_force" in m["code"])
    shown, names = io.StringIO(), {}
    with (
        contextlib.redirect_stdout(shown),
        jax.numpy_dtype_promotion("standard"),
        jax.numpy_rank_promotion("allow"),
    ):
        exec(block["code"], names)
    printed = [float(word) for word in shown.getvalue().split()]
    expected = [float(word) for word in block["shown"].split()]
    np.testing.assert_allclose(printed, expected, rtol=PRINTED)

"""The code of docs/sweeps.md runs, except for the parts that need a cluster."""

import re

import numpy as np
import pytest

from tests.test_sweep.lanes import ROOT

PAGE = ROOT / "docs" / "sweeps.md"


def test_the_code_of_the_page_runs(tmp_path, monkeypatch):
    pytest.importorskip("xarray")
    pytest.importorskip("zarr")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    here = [block for block in blocks if "jax.distributed" not in block]
    assert len(here) == len(blocks) - 2 == 3
    names = {}
    kept, opened, dealt = here
    exec(kept, names)
    stored = names["table"]
    exec(opened, names)
    assert names["stored"].restitution.dims == ("e",)
    exec(dealt, names)
    assert np.array_equal(stored.duration, names["table"].duration)
    stored.to_xarray().to_netcdf("sweep.nc")

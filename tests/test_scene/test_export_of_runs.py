"""Runs and impacts for other tools: xarray, pandas and CSV contain exactly what happened."""

import csv
import io
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc


def fall(e=0.5, **named):
    """A ball that falls on a floor, which is body 0, and a pin that stands by."""
    floor = jc.Plane([0.0, 0.0], [0.0, 1.0], name="floor, wooden")
    pin = jc.Sphere(0.2, None, [2.0, 0.5], fixed=True)
    ball = jc.Sphere(0.1, 2.0, [0.0, 1.0], [0.25, 0.0], name="ball")
    scene = jc.Scene([floor, pin, ball], jc.ExactRestitution(e=e), gravity=[0.0, -9.81])
    return jc.simulate(scene, 1.0, instantaneous=True, **named)


@pytest.fixture(scope="module")
def run():
    return fall(times=np.linspace(0, 1, 5))


@pytest.fixture(scope="module")
def batch():
    """Two lanes with room for eight impacts, of which they need two."""
    runs = eqx.filter_jit(jax.vmap(lambda e: fall(e, max_impacts=8)))
    return runs(jnp.array([0.5, 0.6]))


def test_a_run_as_a_dataset(run, tmp_path):
    xarray = pytest.importorskip("xarray")
    data = run.to_xarray()
    assert data.position.dims == data.velocity.dims == ("time", "sphere", "axis")
    np.testing.assert_array_equal(data.position, run.position)
    np.testing.assert_array_equal(data.velocity.sel(sphere=2, axis="y"), run.velocity[:, 1, 1])
    np.testing.assert_array_equal(data.energy, run.energy)
    assert data.energy.attrs["units"] == "J" and data.position.attrs["units"] == "m"
    assert list(data.sphere.values) == [1, 2] and list(data.name.values) == ["sphere 1", "ball"]
    assert list(data.mass.values) == [np.inf, 2.0] and list(data.radius.values) == [0.2, 0.1]
    np.testing.assert_array_equal(data.impact_time, run.impacts.time)
    assert [str(data.body_name[k].values) for k in data.second] == ["floor, wooden"] * 2
    assert data.solved_by.attrs["flag_meanings"].split()[int(data.solved_by[0])] == "instantaneous"
    assert data.attrs == {"status": "completed", "reached": 1.0, "wall_work": 0.0}
    silent = [name for name, one in data.variables.items() if "long_name" not in one.attrs]
    assert sorted(silent) == ["axis", "body"]
    data.to_netcdf(tmp_path / "run.nc", engine="scipy")
    with xarray.open_dataset(tmp_path / "run.nc", engine="scipy") as back:
        np.testing.assert_array_equal(back.position, run.position)
        assert [str(name) for name in back.body_name.values] == list(run.impacts.names)


def test_a_shell_is_no_sphere(tmp_path):
    pytest.importorskip("xarray")
    bodies = [jc.Shell([0.0], 1.0, name="drum"), jc.Sphere(0.1, 1.0, [0.0], [1.0])]
    scene = jc.Scene(bodies, jc.ExactRestitution(e=0.5))
    data = jc.simulate(scene, 1.0, instantaneous=True).to_xarray()
    assert list(data.sphere.values) == [1] and data.position.shape == (2, 1, 1)
    assert [str(name) for name in data.body_name.values] == ["drum", "sphere 1"]


def test_impacts_as_a_data_frame(run):
    pandas = pytest.importorskip("pandas")
    frame = run.impacts.to_dataframe()
    assert list(frame["first_name"]) == ["ball"] * 2 and list(frame["first"]) == [2, 2]
    assert list(frame["solved_by"]) == ["INSTANTANEOUS"] * 2
    np.testing.assert_array_equal(frame["closing_speed"], run.impacts.closing_speed)
    text = io.StringIO()
    run.impacts.to_csv(text)
    pandas.testing.assert_frame_equal(pandas.read_csv(io.StringIO(text.getvalue())), frame)


def test_csv(run, tmp_path):
    run.to_csv(tmp_path / "run.csv")
    run.impacts.to_csv(tmp_path / "impacts.csv")
    head, *rows = csv.reader((tmp_path / "run.csv").read_text().splitlines())
    places = ("[0,0]", "[0,1]", "[1,0]", "[1,1]")
    assert head == ["time", "energy", *(x + k for x in ("position", "velocity") for k in places)]
    fields = run.time, run.energy, run.position, run.velocity
    numbers = np.hstack([x.reshape(5, -1) for x in fields])
    np.testing.assert_array_equal(np.array(rows, float), numbers)
    rows = list(csv.DictReader((tmp_path / "impacts.csv").read_text().splitlines()))
    assert [row["second_name"] for row in rows] == ["floor, wooden"] * 2
    np.testing.assert_array_equal([float(row["time"]) for row in rows], run.impacts.time)


def test_what_is_padded_is_left_out(batch):
    pytest.importorskip("xarray")
    lane = jax.device_put(jax.tree.map(lambda x: np.asarray(x)[0], batch))
    assert len(lane.impacts) == 8
    assert lane.to_xarray().sizes["impact"] == len(lane.impacts.to_dataframe()) == 2
    text = io.BytesIO()
    lane.impacts.to_csv(text)
    lane.to_csv(text)
    assert b"nan" not in text.getvalue()


def test_batches_are_refused(batch, tmp_path):
    for export in (
        batch.to_xarray,
        batch.impacts.to_dataframe,
        lambda: batch.to_csv(tmp_path / "x.csv"),
        lambda: batch.impacts.to_csv(tmp_path / "x.csv"),
    ):
        with pytest.raises(ValueError, match=r"batch of the shape \(2,\)"):
            export()
    assert list(tmp_path.iterdir()) == []


def test_what_is_missing_is_named(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    monkeypatch.setitem(sys.modules, "pandas", None)
    for export, name in ((run.to_xarray, "xarray"), (run.impacts.to_dataframe, "pandas")):
        with pytest.raises(
            ImportError, match=rf"needs {name}, .* `pip install 'jaxcontact\[data\]'"
        ):
            export()

"""The labelled result: selection, printing, and files for other tools."""

import dataclasses
import pickle
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from tests.test_sweep.lanes import outcome

CONTACT = jc.Contact(1.0, 1e8)
E = np.linspace(0.1, 1.0, 10)
V = np.array([1.0, 3.0, -1.0])
SAMPLES = {"e": [0.3, 0.6, 0.9], "v": [1.0, 2.0, 3.0]}


def alone(e, v):
    return jc.restitution(jc.HuGuo(e=e), CONTACT, v)


@pytest.fixture(scope="module")
def table():
    return jc.sweep(outcome, e=E, v=V)


def test_fields(table):
    assert table.shape == (10, 3) and table.dims == ("e", "v")
    assert list(table.axes) == ["e", "v"]
    np.testing.assert_array_equal(table.axes["v"], V)
    assert table.method == "exact" and table.error_estimate is None
    assert table["duration"] is table.duration
    assert "duration" in dir(table) and "select" in dir(table)
    assert table.complete
    with pytest.raises(AttributeError, match=r"no field 'nonsense'; its fields: restitution, "):
        _ = table.nonsense
    with pytest.raises(KeyError, match="nonsense"):
        _ = table["nonsense"]
    with pytest.raises(ValueError, match="read-only"):
        table.restitution[0, 0] = 1.0


class Pair(NamedTuple):
    twice: jax.Array
    nested: dict


class Module(eqx.Module):
    twice: jax.Array
    nested: dict
    words: str = eqx.field(static=True, default="static")


@pytest.mark.parametrize("kind", [Pair, Module, lambda a, b: {"twice": a, "nested": b}])
def test_outputs_with_names(kind):
    table = jc.sweep(lambda e: kind(2 * e, {"a": e, "b": (e, 3 * e)}), e=[1.0, 2.0])
    np.testing.assert_array_equal(table.twice, [2.0, 4.0])
    np.testing.assert_array_equal(table.nested["b"][1], [3.0, 6.0])
    assert set(table.nested) == {"a", "b"}
    if kind is Module:
        assert table.words == "static"


def test_outputs_without_names():
    np.testing.assert_array_equal(jc.sweep(lambda e: 2 * e, e=[1.0, 2.0]).value, [2.0, 4.0])
    first, second = jc.sweep(lambda e: (e, [e]), e=[1.0, 2.0]).value
    np.testing.assert_array_equal(first, second[0])


def test_what_is_held_fixed():
    def law(name, e, v, steps):
        hits = [jc.restitution(jc.get_law(name, e=e), CONTACT, v) for _ in range(steps)]
        return {"e": sum(hits), "method": f"{steps} times"}

    table = jc.sweep(law, name="hu_guo", e=[0.3, 0.8], v=2.0, steps=3)
    assert table.shape == (2,)
    assert table.fixed == {"v": 2.0, "name": "hu_guo", "steps": 3}
    assert table.method == "3 times"
    np.testing.assert_allclose(table.e, 3 * jc.restitution(jc.HuGuo(e=table.axes["e"])))
    assert "fixed   v = 2, name = hu_guo, steps = 3" in repr(table)


@dataclasses.dataclass(frozen=True)
class Power:
    exponent: int

    def __call__(self, e):
        return e**self.exponent


class Scaled(eqx.Module):
    factor: float
    squared: bool = eqx.field(static=True, default=False)

    def __call__(self, e):
        return self.factor * e ** (1 + self.squared)


@pytest.mark.parametrize(
    ("how", "other"),
    [
        (Power(2), Power(3)),
        (Scaled(3.0), Scaled(3.0, squared=True)),
        # Not hashable, as they contain arrays.
        (Scaled(np.asarray(2.0)), Scaled(np.asarray(5.0))),
    ],
)
def test_objects_are_passed_on_as_they_are(how, other):
    for given in (how, other, how):
        table = jc.sweep(lambda e, how: how(e), e=[0.5, 0.7], how=given)
        np.testing.assert_array_equal(table.value, given(np.array([0.5, 0.7])))
        assert table.fixed["how"] is given
        assert table.select(e=0.5).fixed["how"] is given
        assert "fixed   how = " in repr(table)


def test_select(table):
    one = table.select(e=0.5)
    assert one.shape == (3,) and one.dims == ("v",) and one.fixed["e"] == E[4]
    np.testing.assert_array_equal(one.duration, table.duration[4])
    np.testing.assert_array_equal(one.status, table.status[4])
    # The 0.3 of linspace differs from 0.3.
    assert E[2] != 0.3
    np.testing.assert_array_equal(table.select(e=0.3).duration, table.duration[2])
    lane = table.select(v=3, e=1)
    assert lane.shape == () and lane.duration == table.duration[9, 1]
    assert table.select(v=-1.0).status_counts() == {int(jc.Status.INVALID_INPUT): 10}
    near = table.select(e=0.52, method="nearest")
    np.testing.assert_array_equal(near.duration, table.duration[4])
    for wrong, words in [
        ({"e": 0.52}, r"`e` must be a number of the axis, but is 0.52; near it"),
        ({"e": 0.51}, r"near it are 0.4, 0.5, 0.6 .*nearest"),
        ({"m": 1.0}, r"`m` must be a dimension of the sweep, .*: e, v"),
    ]:
        with pytest.raises(ValueError, match=words):
            table.select(**wrong)


def test_select_keeps_what_is_unknown_of_other_axes():
    bad = jc.sweep(alone, e=[0.3, 0.9], v=V)
    assert bad.columns()["value"].dims == (0,)
    np.testing.assert_array_equal(bad.select(v=-1).value, [np.nan, np.nan])
    np.testing.assert_array_equal(bad.select(v=3).value, bad.value[:, 1])
    np.testing.assert_array_equal(bad.select(e=0.3).value, bad.value[0])
    np.testing.assert_array_equal(bad.select(e=0.3).status, [0, 0, 3])


def test_select_a_sample():
    table = jc.sweep(outcome, samples=SAMPLES)
    one = table.select(sample=1)
    assert one.fixed["e"] == 0.6 and one.fixed["v"] == 2.0
    assert one.duration == table.duration[1]
    with pytest.raises(ValueError, match=r"`e` must be a dimension of the sweep, .*: sample"):
        table.select(e=0.3)


def test_status_of_an_output_without_one():
    def partly(e, v):
        return jnp.where(jnp.abs(e - 0.5) < 0.01, jnp.nan, jnp.where(v > 0, e, jnp.nan))

    table = jc.sweep(partly, e=[0.2, 0.5], v=[1.0, -1.0])
    np.testing.assert_array_equal(table.status, [[0, 3], [2, 3]])
    # Without a check in the function only NaN is a sign of failure; infinity may be correct.
    table = jc.sweep(lambda e: jnp.log(e), e=[1.0, -1.0, 0.0])
    np.testing.assert_array_equal(table.status, [0, 2, 0])


def test_repr(table):
    assert repr(table).splitlines() == [
        "Sweep of outcome: e 10 × v 3, 30 lanes",
        "  e       0.1 to 1",
        "  v       1, 3, -1 m/s",
        "  fields  restitution(e, v), rebound_velocity(e, v), duration(e, v), "
        "compression_time(e, v),",
        "          max_indentation(e, v), max_force(e, v), energy_loss(e, v), status(e, v)",
        "  status  20 separated, 10 invalid_input",
    ]
    assert "value(e)" in repr(jc.sweep(alone, e=E, v=[1.0, 2.0]))
    assert repr(jc.sweep(lambda: 1.0)).startswith("Sweep of <lambda>: no axes, 1 lanes")


def test_pickles(table):
    again = pickle.loads(pickle.dumps(table))
    np.testing.assert_array_equal(again.duration, table.duration)
    np.testing.assert_array_equal(again.status, table.status)
    assert repr(again) == repr(table)


@pytest.mark.parametrize(
    ("status", "shown"),
    [
        (lambda x: (x < 1).astype(bool), ["SETTLED", "SEPARATED"]),
        (lambda x: (x < 1).astype(float), ["SETTLED", "SEPARATED"]),
        # Numbers for all if one of them has no name.
        (lambda x: jnp.where(x < 1, 0, 7), ["0", "7"]),
    ],
)
def test_csv_names_every_status_or_numbers_all(tmp_path, status, shown):
    jc.sweep(lambda x: {"status": status(x)}, x=np.arange(2.0)).to_csv(tmp_path / "x.csv")
    assert (tmp_path / "x.csv").read_text() == "x,status\n0.0,{}\n1.0,{}\n".format(*shown)


def test_csv_of_samples_with_own_shapes(tmp_path):
    samples = {"e": [0.3, 0.6], "h": [1.0, 2.0]}
    table = jc.sweep(lambda e, h: jc.bounce(jc.HuGuo(e=e), CONTACT, h, bounces=2), samples=samples)
    table.to_csv(tmp_path / "table.csv")
    head, *rows = (tmp_path / "table.csv").read_text().splitlines()
    assert head.startswith("e,h,time[0],time[1],duration[0]")
    assert len(rows) == 2
    assert float(rows[1].split(",")[3]) == table.time[1, 1]


def test_xarray(table, tmp_path):
    xarray = pytest.importorskip("xarray")
    data = table.to_xarray()
    assert data.duration.dims == ("e", "v")
    assert data.duration.attrs == {"long_name": "duration of contact", "units": "s"}
    assert data.v.attrs["units"] == "m/s"
    assert data.status.attrs["flag_meanings"].split()[3] == "invalid_input"
    assert data.attrs["function"] == "outcome" and data.attrs["method"] == "exact"
    np.testing.assert_array_equal(data.sel(e=0.5, method="nearest").max_force, table.max_force[4])
    data.to_netcdf(tmp_path / "table.nc", engine="scipy")
    with xarray.open_dataset(tmp_path / "table.nc", engine="scipy") as back:
        np.testing.assert_array_equal(back.duration, table.duration)
        np.testing.assert_array_equal(back.status, table.status)
        assert back.max_force.attrs["units"] == "N"


def test_xarray_of_samples():
    pytest.importorskip("xarray")
    data = jc.sweep(alone, samples=SAMPLES).to_xarray()
    assert data.value.dims == ("sample",) and data.e.dims == ("sample",)
    assert list(data.status.values) == [0, 0, 0]
    fixed = jc.sweep(alone, e=[0.3], v=2.0).to_xarray()
    assert fixed.v.dims == () and float(fixed.v) == 2.0


def test_single_precision():
    with jax.enable_x64(False):
        table = jc.sweep(lambda e: jc.restitution(jc.HuGuo(e=e)), e=np.linspace(0.1, 1, 5))
        assert table.axes["e"].dtype == table.value.dtype == np.float32
        assert table.select(e=0.325).value == table.value[1]

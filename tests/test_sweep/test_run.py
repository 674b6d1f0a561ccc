"""A running sweep: its reports, its interruption, and its compilations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._sweep.planning import plan as _plan
from tests.test_sweep.lanes import outcome


def test_a_sweep_off_a_terminal_says_nothing(capsys):
    jc.sweep(outcome, e=[0.3, 0.6], v=[1.0])
    assert capsys.readouterr() == ("", "")


def interrupted(after, function=outcome, **more):
    def listen(done, total):
        if done >= after:
            raise KeyboardInterrupt

    return jc.sweep(function, progress=listen, batch_size=10, **more)


AXES = {"e": np.linspace(0.1, 1, 10), "v": np.array([1.0, 2.0, -1.0, 4.0, 5.0])}


def test_an_interrupt_leaves_what_is_done():
    whole = jc.sweep(outcome, **AXES, batch_size=10)
    with pytest.warns(UserWarning, match=r"interrupted with 50 % of its work done"):
        table = interrupted(21, **AXES)
    assert not table.complete and whole.complete
    done = np.zeros((10, 5), bool)
    # The checks (10), and two blocks of two rows.
    done[:4] = True
    for name in ("duration", "max_force", "rebound_velocity", "restitution"):
        np.testing.assert_array_equal(table[name][done], whole[name][done])
        assert np.all(np.isnan(table[name][~done]))
    np.testing.assert_array_equal(table.status[done], whole.status[done])
    bad = np.broadcast_to(AXES["v"] < 0, (10, 5))
    expected = np.where(bad, int(jc.Status.INVALID_INPUT), int(jc.Status.NOT_CONVERGED))
    np.testing.assert_array_equal(table.status[~done], expected[~done])
    assert "50 % of the work is done" in repr(table)
    assert not table.select(e=AXES["e"][0]).complete


def test_an_interrupt_in_the_middle_of_ordered_lanes():
    cost = np.random.default_rng(0).permutation(50)
    samples = {"e": np.linspace(0.1, 1, 50), "v": 1.0 + cost}
    with pytest.warns(UserWarning, match="interrupted"):
        table = interrupted(70, samples=samples, cost=lambda v: v)
    # The checks are done for all lanes, and two of five blocks with the most expensive lanes.
    np.testing.assert_array_equal(np.isnan(table.duration), cost < 30)


def test_an_interrupt_of_a_fold_keeps_what_is_folded():
    def fold(lanes, block):
        return lanes + block.shape[0] * block.shape[1]

    with pytest.warns(UserWarning, match="interrupted with 40 %"):
        table = interrupted(20, **AXES, reduce=(0, fold))
    assert table.value == 20 and not table.complete


def test_an_interrupt_before_anything_is_done_is_passed_on():
    def fold(value, block):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        jc.sweep(outcome, **AXES, reduce=(0, fold))


def whole_numbers(e, v):
    return {"count": jnp.int32(10 * e + v)}


def with_status(e, v):
    return {"status": jnp.int32(e), "duration": e * v, "count": jnp.int32(v + 10 * e)}


@pytest.mark.parametrize("function", [whole_numbers, with_status])
def test_an_interrupt_flags_whole_numbers_too(function):
    """They have no NaN that would show it."""
    axes = {"e": np.arange(10.0), "v": np.arange(5.0)}
    with pytest.warns(UserWarning, match="interrupted"):
        table = interrupted(21, function, **axes)
    assert not table.complete
    right = table["count"] == np.int32(10 * axes["e"][:, None] + axes["v"])
    assert 0 < np.count_nonzero(right) < right.size
    # The function itself may say so.
    own, bad = function is with_status, int(jc.Status.NOT_CONVERGED)
    lost, failed = (axes["e"] == bad) & own, (table["status"] if own else table.status) == bad
    np.testing.assert_array_equal(failed, ~right | lost[:, None])
    np.testing.assert_array_equal(table.select(e=9.0).status, table.status[9])


def made_of(e, v):
    return {"e": jc.restitution(jc.HuGuo(e=e)), "v": jnp.sqrt(v) * e}


def test_the_same_function_is_analysed_once(monkeypatch):
    analysed = []
    analyst = _plan.Analyst
    monkeypatch.setattr(_plan, "Analyst", lambda *x: analysed.append(1) or analyst(*x))
    # A unique value, not shared with another test.
    factor = 17.0

    def again():
        return lambda e, v, how=None: factor * made_of(e, v)["v"]

    for size in (3, 3, 4):
        jc.sweep(again(), e=np.linspace(0.1, 1, size), v=[1.0, 2.0])
    assert len(analysed) == 1
    # Other fixed numbers do not change the program, nor do objects that it does not read.
    for v in (1.0, 2.0, 3.0):
        jc.sweep(again(), e=[0.5], v=v, how=object())
    assert len(analysed) == 2
    factor = 18.0
    jc.sweep(again(), e=[0.5], v=1.0)
    assert len(analysed) == 3


def test_another_sweep_of_a_function_compiles_nothing(compiled):
    def function(e, v):
        return made_of(e, 19.0 * v)

    samples = {"e": np.linspace(0.1, 1, 100), "v": np.linspace(1, 2, 100)}
    jc.sweep(function, samples=samples, batch_size=10)
    assert compiled
    compiled.clear()
    jc.sweep(function, samples={k: x[::-1] for k, x in samples.items()}, batch_size=10)
    # Blocks of one shape, also for another number of lanes.
    jc.sweep(function, samples={k: x[:95] for k, x in samples.items()}, batch_size=10)
    assert compiled == []
    jc.sweep(lambda e, v: function(v, e), samples=samples, batch_size=10)
    assert compiled


def test_later_blocks_have_the_precision_of_the_caller():
    """They run in other threads, which do not inherit it."""
    few = np.linspace(0.3, 0.9, 40, dtype=np.float32)
    with jax.enable_x64(False):
        contact = jc.Contact(1.0, 1e8)
        restitution = lambda e: jc.restitution(jc.HuGuo(e=e), contact, 1.0)  # noqa: E731
        found = jc.sweep(restitution, e=few, batch_size=10, progress=False).value
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, jc.restitution(jc.HuGuo(e=few)), rtol=1e-5)

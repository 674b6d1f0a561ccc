"""A single call that fails numerically raises; batches and traced calls flag their lanes.

Every failure comes from input: too few steps, too little room, a number out of its range.
"""

import contextlib
import dataclasses
import inspect
import io
import pickle
import sys
import time
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._scene.engine import pieces
from jaxcontact._text import progress as _progress
from jaxcontact._text.progress import Stages, in_notebook, progress_of, stages_of
from jaxcontact._text.units import label, meaning, quantity
from jaxcontact._text.words import text_table, wrapped
from tests.test_impact.test_new_form import Plain

CONTACT = jc.Contact(1.0, 1e6)
SHORT = jc.Event(max_steps=20)  # enough for e = 0.9, not for e = 0.01


def impact(e, **how):
    return jc.impact(jc.HuGuo(e=e), CONTACT, 1.3, method=SHORT, **how)


def bounce(e, **how):
    return jc.bounce(jc.HuGuo(e=e), CONTACT, 1.0, bounces=2, method=SHORT, **how)


def simulate(e, **how):
    """A ball between two walls; a faster one has more impacts than there is room."""
    ball = jc.Sphere(0.1, 1.0, [0.0], jnp.stack([1.0 / jnp.asarray(e)]))
    walls = jc.Plane([-1.0], [1.0]), jc.Plane([1.0], [-1.0])
    scene = jc.Scene([ball, *walls], jc.Hertz())
    return jc.simulate(scene, 2.0, instantaneous=True, max_impacts=1, **how)


CALLS = {
    "impact": (impact, 0.01, "NOT_CONVERGED. The solve did not converge. Try another method"),
    "bounce": (bounce, 0.01, "NOT_CONVERGED. The solve did not converge. Try another method"),
    "simulate": (simulate, 0.1, "TOO_MANY_IMPACTS. Pass a larger `max_impacts`"),
}
GOOD = 0.9


@pytest.mark.parametrize("name", CALLS)
def test_a_single_call_raises_and_lanes_are_flagged(name):
    call, bad, words = CALLS[name]
    with pytest.raises(jc.NumericalError, match=f"`{name}` failed: {words}.*`throw=False`"):
        call(bad)
    with pytest.raises(jc.NumericalError, match=words):
        call(jnp.asarray(bad))
    flagged = call(bad, throw=False)
    assert not flagged.ok and flagged.ok.dtype == bool and flagged.ok.shape == ()
    good = call(GOOD)
    assert good.ok
    lanes = jnp.array([GOOD, bad, GOOD])
    # `simulate` has no lanes of its own, and flags those that are traced.
    many = jax.jit(jax.vmap(call))(lanes) if name == "simulate" else call(lanes)
    assert many.ok.tolist() == [True, False, True]
    for field in ("position", "restitution"):
        if (values := getattr(many, field, None)) is not None:
            np.testing.assert_allclose(values[0], getattr(good, field), rtol=1e-12)
            assert np.isfinite(values[2]).all() and not np.isfinite(values[1]).all()


def test_traced_calls_and_derivatives_outside_of_jit_flag():
    """In derivatives the status is concrete, and other leaves are tracers."""
    inside = jax.jit(lambda e: impact(e).ok)
    assert not inside(0.01) and inside(GOOD)
    (_, ok), slope = jax.value_and_grad(
        lambda e: (lambda hit: (hit.restitution, hit.ok))(impact(e)), has_aux=True
    )(0.01)
    assert not ok and not slope > 0


def test_results_that_are_no_failure():
    settled = jc.impact(jc.WetRestitution(e=0.5, critical_speed=0.1), CONTACT, 1e-3)
    assert settled.status == jc.Status.SETTLED and settled.ok
    gives = Plain(c=-40.0), jc.Contact(1.0, 1e6, 1.0), 1.0
    assert jc.impact(*gives).status == jc.Status.GAINED
    with pytest.raises(jc.NumericalError, match="`bounce` failed: GAINED"):
        jc.bounce(*gives, bounces=2)
    flying = jc.bounce(jc.HuGuo(e=0.9), CONTACT, 1.0, bounces=2)
    assert not flying.at_rest and flying.ok


def line(params, x):
    return jnp.exp(params["a"] * x)


def test_a_fit_that_does_not_converge_raises():
    x = np.linspace(0, 1, 9)
    how = {"data": np.exp(2 * x), "start": {"a": 0.1}, "x": x}
    assert jc.fit(line, **how).ok
    words = "`fit` failed: NOT CONVERGED, 1 steps were not enough: .*`max_steps`.*`throw=False`"
    with pytest.raises(jc.NumericalError, match=words):
        jc.fit(line, **how, max_steps=1)
    flagged = jc.fit(line, **how, max_steps=1, throw=False)
    assert not flagged.ok and flagged.ok.dtype == bool and flagged.steps == 1
    # So does a ready-made one.
    v = np.geomspace(0.5, 3, 8)
    with pytest.raises(jc.NumericalError, match="`fit_damping` failed: NOT CONVERGED"):
        jc.fit_damping(CONTACT, v, 0.9 - 0.05 * v, max_steps=1)
    assert not jc.fit_damping(CONTACT, v, 0.9 - 0.05 * v, max_steps=1, throw=False).ok


def test_the_error_and_the_outcomes_can_be_pickled():
    with pytest.raises(jc.NumericalError) as caught:
        impact(0.01)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)
    assert pickle.loads(pickle.dumps(jc.Ending.CROWDED)) is jc.Ending.CROWDED
    assert jc.Status(4) is jc.Status.GAINED and jc.Status.GAINED.words.startswith("e > 1")


# The progress bar: silent for a second, on stderr only; tables, words and units of labels.


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def at_once(monkeypatch):
    """No second of patience, and every state is written."""
    for name in ("_PATIENCE", "_TERMINAL", "_FILE"):
        monkeypatch.setattr(_progress, name, 0.0)


def written(wanted, reports, stream=None):
    """What a run with these reports writes on stderr, as the states of its bar."""
    err = io.StringIO() if stream is None else stream
    with contextlib.redirect_stderr(err), progress_of(wanted, "lanes", "sweep") as tell:
        for report in reports:
            tell(*report)
    return [state for state in err.getvalue().split("\r") if state]


@pytest.mark.usefixtures("at_once")
def test_count_rate_and_time_left():
    states = written(True, [(1_000_000, 4_000_000), (4_000_000, 4_000_000)])
    assert any("25%" in state and "1.00M/4.00M" in state for state in states)
    assert states[-1].startswith("sweep: 100%") and " lanes/s" in states[-1]
    assert states[-1].endswith("\n")
    # An unknown total, and a note that changes.
    states = written(True, [(1, None, "loss 0.5"), (1, None, "loss 0.4"), (7, None, "loss 0.1")])
    assert any("loss 0.4" in state for state in states)
    assert "7.00 lanes" in states[-1] and "loss 0.1" in states[-1] and "%" not in states[-1]


def test_a_bar_is_shown_after_a_second_and_seldom_in_a_file(monkeypatch):
    assert written(True, [(10, 10)]) == []
    asked = []

    def bar(**options):
        asked.append((options["delay"], options["mininterval"]))
        return io.StringIO()

    monkeypatch.setattr(_progress, "_bar_type", lambda: bar)
    for stream in (io.StringIO(), Terminal()):
        with contextlib.redirect_stderr(stream), progress_of(True, "lanes", "sweep"):
            pass
    assert asked == [(1.0, 10.0), (1.0, 0.2)]


@pytest.mark.usefixtures("at_once")
def test_who_is_told(capsys):
    reports = [(1, 2), (2, 2)]
    assert written(None, reports) == [] == written(False, reports, Terminal())
    assert written(None, reports, Terminal()) and written(True, reports)
    told = []
    assert written(lambda done, total: told.append((done, total)), [*reports, (3, None, "a")]) == []
    assert told == [(1, 2), (2, 2), (3, None)]
    assert capsys.readouterr() == ("", "")


@pytest.mark.usefixtures("at_once")
def test_notebooks(monkeypatch):
    assert not in_notebook()

    shell = types.SimpleNamespace(kernel=object())
    python = types.SimpleNamespace(get_ipython=lambda: shell)
    monkeypatch.setitem(sys.modules, "IPython", python)
    assert in_notebook()
    # Without ipywidgets it is a line of text, without a warning, which would be an error here.
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert "100%" in written(None, [(2, 2)])[-1]


@pytest.mark.usefixtures("at_once")
@pytest.mark.parametrize(("wanted", "err"), [(None, Terminal()), (True, io.StringIO())])
def test_a_run_says_that_it_compiles_while_it_is_blocked(wanted, err):
    with contextlib.redirect_stderr(err), _progress.progress_of_run(wanted) as tell:
        tell.says("compiling")
        until = time.monotonic() + 10
        while err.getvalue().count(", compiling") < 3 and time.monotonic() < until:
            time.sleep(0.02)
    assert err.getvalue().count(", compiling") >= 3


def test_the_time_left_counts_no_compilation(monkeypatch):
    clock, notes = iter((20.0, 26.0, 80.0)), []
    monkeypatch.setattr(_progress.time, "monotonic", lambda: next(clock))
    say = lambda done, total=None, note="", /: notes.append(note)  # noqa: E731
    tell = _progress.TellRun(say, False)
    tell(1, "hits", 1.0, 4.0)
    tell(2, "hits", 2.0, 4.0)
    tell.says("compiling")
    tell(3, "hits", 3.0, 4.0)
    assert notes[1] == "t = 2 of 4 s, 2 hits, 12 s left" and "left" not in notes[0] + notes[3]


@pytest.mark.usefixtures("at_once")
def test_runs_of_scenes(monkeypatch):
    discs = jc.random_spheres(32, low=[0, 0], high=[1, 1], radius=0.03, mass=1.0, speed=1.0, seed=1)
    scene = jc.Scene([*discs, jc.Box([0, 0], [1, 1])], law=jc.ExactRestitution(e=1.0))
    used, program, told, ends = [], pieces._quickly, [], []
    for name in ("_quickly", "_swiftly"):
        monkeypatch.setattr(pieces, name, lambda *of, name=name: used.append(name) or program(*of))
    monkeypatch.setattr(pieces, "_PATIENCE", 500)
    for lasts, wanted in ((0.5, False), (4.0, None), (4.0, lambda *said: told.append(said))):
        monkeypatch.setattr(pieces, "_RUN", {})
        with contextlib.redirect_stderr(Terminal()) as err:
            ends.append(jc.simulate(scene, lasts, instantaneous=True, progress=wanted).position)
        assert (" s left" in err.getvalue()) == (wanted is None) == bool(err.getvalue())
    np.testing.assert_array_equal(ends[1], ends[2])
    assert told[:2] == [(256, None), (512, None)] and len(told) == 3
    assert used == ["_quickly"] + ["_quickly", "_swiftly", "_swiftly"] * 2


@pytest.mark.parametrize(
    ("wanted", "seconds", "stream", "shown"),
    [
        (None, 0.9, Terminal(), False),
        (None, 1.1, Terminal(), True),
        (None, 1.1, io.StringIO(), False),
        (True, 0.0, io.StringIO(), True),
        (False, 1.1, Terminal(), False),
    ],
)
def test_stages_are_shown_after_a_second(monkeypatch, wanted, seconds, stream, shown):
    with contextlib.redirect_stderr(stream):
        stages = stages_of(wanted)
        monkeypatch.setattr(stages, "_start", time.monotonic() - seconds)
        stages("fitting")
        Stages(quiet=True)("writing")
    assert stream.getvalue() == (f"[  {seconds} s] fitting ...\n" if shown else "")


def test_one_default():
    takers = jc.simulate, jc.sweep, jc.calibrate, jc.report, jc.fit, jc.choose_law, jc.fit_damping
    assert {inspect.signature(f).parameters["progress"].default for f in takers} == {None}


# Tables and wrapped text, character by character; words and units of labels.

# Self-explanatory names, and names that are not quantities.
PLAIN = {"restitution", "status", "method", "solver"}


@pytest.mark.parametrize("result", [jc.Impact, jc.Bounce])
def test_all_that_a_result_holds_has_words(result):
    names = {field.name for field in dataclasses.fields(result)}
    assert {name for name in names if meaning(name) == (name, "")} <= PLAIN


@pytest.mark.parametrize(
    ("names", "text"),
    [
        (["v", "v0", "velocity", "impact_velocity"], "closing speed / (m/s)"),
        (["m", "mass"], "effective mass / kg"),
        (["K", "stiffness"], "contact stiffness / (N/m^n)"),
        (["n", "exponent"], "exponent n"),
        (["R", "radius"], "radius / m"),
        (["unheard_of"], "unheard_of"),
    ],
)
def test_labels(names, text):
    assert [label(name) for name in names] == [text] * len(names)


def test_other_words_a_prefix_and_a_number():
    assert label("duration", "contact", prefix="m") == "contact / ms"
    assert label("v", prefix="k") == "closing speed / (km/s)"
    assert quantity("velocity", "4.2") == "4.2 m/s" and quantity("e", "0.5") == "0.5"


def test_columns_are_as_wide_as_their_widest_cell():
    rows = [("a", "1.5", ""), ("longer", "10.25", "note")]
    assert text_table(rows, header=("", "number"), align="<>", indent=2, rule=True) == [
        "          number",
        "  --------------------",
        "  a          1.5",
        "  longer   10.25  note",
    ]
    assert text_table([("a", "b"), ("cc", "d")], gap=1) == ["a  b", "cc d"]
    assert text_table([]) == []


def test_wrapped_text():
    lines = wrapped("fields", "one-two three four", width=20, indent=8, lead="  ")
    assert lines == ["  fields one-two", "        three four"]
    assert wrapped("Pairs", "many") == ["Pairs      many"]
    assert wrapped("Pairs", "") == []

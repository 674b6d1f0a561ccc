"""Every public argument refuses bad values with an error that names it.

Sixty kinds of values are passed for each argument. A legal one must be accepted. Any other must
raise an error that names the argument, the allowed values and the given value. No error of JAX,
NumPy or another library may come through.
"""

import functools
import importlib
import inspect
import re
import warnings

import jax
import numpy as np
import pytest

import jaxcontact as jc
from tests.public_names import members
from tests.test_every_argument import fits, friction, measured, physics, results, scenes, systems
from tests.test_every_argument.case import EXEMPT, Reached, is_exempt, reached
from tests.test_every_argument.kinds import KINDS


@functools.cache
def cases():
    rooms = (physics, fits, measured, results, scenes, systems, friction)
    every = [case for room in rooms for case in room.cases()]
    assert len({case.label for case in every}) == len(every)
    return {case.label: case for case in every}


LABELS = sorted(cases())


def some_readings(model, space, theta, speeds):
    """Slopes and readings of a plan; one quantity alone does not determine two parameters."""
    slopes = np.random.default_rng(0).normal(size=(len(model.fields), len(theta)))
    slopes = np.repeat(slopes, len(speeds), axis=0)
    return slopes, np.ones(len(slopes))


WORK = """
    lab.design.best_rows lab.design.Rival lab.oblique.fit_oblique._predicted
    engines.scenes.export_scene.matched _fit.fit.find _fit.fit.find_all _fit.compare.find
    _fit.many.fit_many.search_all _fit.uncertainty.bootstrap.refits
    _fit.uncertainty.interval._held _fit.posterior.posterior.find_mode
    _fit.posterior.posterior.draw _friction.maw_barber_fawcett._odd_curve
    _impact.oblique.oblique_trajectory._oblique_trajectory _system.simulate._begin
"""


@pytest.fixture(autouse=True)
def nothing_is_compiled(monkeypatch, tmp_path, usual_promotion):
    """Searches, bootstraps and profiles count as reached; files go to an empty folder."""
    monkeypatch.chdir(tmp_path)
    for module, name in (place.rsplit(".", 1) for place in WORK.split()):
        monkeypatch.setattr(importlib.import_module(f"jaxcontact.{module}"), name, reached)
    design = importlib.import_module("jaxcontact.lab.design")
    monkeypatch.setattr(design, "_compiled", some_readings)
    with warnings.catch_warnings():
        # Some conversions of NumPy warn before they fail.
        warnings.simplefilter("ignore")
        yield


LAWS = "base hunt_crossley plastic"


@pytest.fixture
def no_force_is_computed(monkeypatch):
    """The force of a law counts as reached once its arguments are accepted."""
    for name in LAWS.split():
        module = importlib.import_module(f"jaxcontact._laws.{name}")
        check = module.force_arguments
        monkeypatch.setattr(module, "force_arguments", lambda *of, check=check: reached(check(*of)))


def one_line(text):
    return " ".join(text.split())


@functools.cache
def words_of(kind):
    """The words by which a message shows a value, its type or shape, or what is wrong inside it."""
    value = KINDS[kind]
    try:
        text = one_line(repr(value))
    except (RuntimeError, ValueError):
        return {type(value).__name__}
    inside = []
    if isinstance(value, list | tuple | dict | set | range):
        inside = list(value)
    elif isinstance(getattr(value, "shape", None), tuple) and hasattr(value, "tolist"):
        inside = np.ravel(np.asarray(value, object)).tolist()
    words = {text[:15], one_line(str(value)), type(value).__name__, *map(repr, inside)}
    words |= {f"{x:g}" for x in inside if isinstance(x, int | float)}
    words |= {f"holds {len(inside)}", f"has {len(inside)}", f"{len(inside)} points"}
    words |= {str(getattr(value, "shape", (len(inside),)))}
    return words - {""}


def fault_of(label, name, kind):
    """What is wrong with the answer of a callable to one kind of value; None if nothing is."""
    case, value, message = cases()[label], KINDS[kind], None
    legal = kind in case.legal[name]
    try:
        case.call(name, value)
    except (Reached, OSError):  # a valid path of a missing file: documented
        pass
    except (ValueError, TypeError) as error:
        message = one_line(str(error))
        ours = f"`{name}`" in message and re.search("must|is needed|is no known", message)
        if not ours and not isinstance(error, jc.RecordingError):
            return f"{type(error).__name__} that does not name it: {message[:200]}"
        shown = any(word in message for word in words_of(kind))
        if not shown and not isinstance(error, jc.RecordingError):
            return f"the message does not show the value: {message[:200]}"
    except Exception as error:  # an error of any other type is the fault this test detects
        return f"raw {type(error).__name__}: {one_line(str(error))[:200]}"
    if legal and message is not None:
        return f"refused: {message[:200]}"
    if not legal and message is None:
        return "accepted"
    return None


@pytest.mark.usefixtures("no_force_is_computed")
@pytest.mark.parametrize("label", LABELS)
def test_every_kind_of_value(label):
    faults = {
        (name, kind): fault
        for name in cases()[label].legal
        for kind in KINDS.keys() - cases()[label].untested
        if (fault := fault_of(label, name, kind)) is not None
    }
    assert not faults, "\n".join(f"{n} <- {k}: {fault}" for (n, k), fault in faults.items())


@functools.cache
def public():
    """Every public callable by name, with its arguments: functions, constructors and methods."""
    return {
        name.removeprefix("jaxcontact."): (value, {x for x in given if not x.startswith("*")})
        for name, value, given in members()
        if inspect.isclass(value) or inspect.isroutine(value)
    }


def origin(function):
    """Where a function was defined: an inherited method is tested once."""
    return getattr(function, "__module__", ""), function.__qualname__


def test_every_argument_is_in_the_table():
    """A new public argument must be added to the table, or exempted there with a reason."""
    tested = {}
    for label, case in cases().items():
        where = origin(public().get(label.split(",")[0], (case.function,))[0])
        tested.setdefault(where, set()).update(case.legal)
    missing = [
        argument
        for name, (function, given) in public().items()
        for one in sorted(given - tested.get(origin(function), set()))
        if not is_exempt(argument := f"{name}({one})")
    ]
    assert not missing, "\n".join(missing)


def test_exemptions_are_needed():
    names = [f"{name}({one})" for name, (_, given) in public().items() for one in given]
    for patterns in EXEMPT.values():
        for pattern in patterns.split():
            assert any(re.fullmatch(pattern, name) for name in names), pattern


TWO, THREE, STEEL = [0.1, 0.2], [0.1, 0.2, 0.3], jc.Material(2.1e11, [0.3, 0.3], 7800.0)
LAW, UNIT, CONTACTS = jc.HuGuo(e=0.5), jc.Contact(1.0, 1.0), jc.Contact([1.0, 2.0], 1e6)
OF_THREE, SPHERES = jc.HuGuo(e=THREE), jc.Contact.sphere_sphere
MISFITS = {
    "impact": (lambda: jc.impact(LAW, CONTACTS, THREE), "contact velocity"),
    "force": (lambda: jc.impact(OF_THREE, UNIT, 1.0, external_force=TWO), "law external_force"),
    "contact": (lambda: jc.impact(LAW, jc.Contact(TWO, THREE), 1.0), "contact"),
    "restitution": (lambda: jc.restitution(jc.HuGuo(e=TWO), None, THREE), "law velocity"),
    "trajectory": (lambda: jc.trajectory(LAW, CONTACTS, THREE), "contact velocity"),
    "bounce": (lambda: jc.bounce(LAW, CONTACTS, 1.0, gravity=THREE), "contact gravity"),
    "law.force": (lambda: jc.Tsuji(e=0.5).force(THREE, TWO, UNIT, 1.0), "indentation velocity"),
    "sphere_plane": (lambda: jc.Contact.sphere_plane(THREE, STEEL), "radius sphere"),
    "sphere_sphere": (lambda: SPHERES(TWO, THREE, STEEL, STEEL), "radius other_radius"),
    "sphere_socket": (lambda: jc.Contact.sphere_socket(0.1, THREE, STEEL), "socket_radius sphere"),
    "sphere_mass": (lambda: jc.Material(1.0, 0.3, TWO).sphere_mass(THREE), "radius density"),
}


@pytest.mark.parametrize("name", MISFITS)
def test_shapes_that_do_not_broadcast(name):
    call, named = MISFITS[name]
    with pytest.raises(ValueError, match=r"broadcast, but have .*\(3,\)") as error:
        call()
    assert "must have shapes that broadcast" in str(error.value)
    assert all(f"`{one}`" in str(error.value) for one in named.split())


def test_large_whole_numbers_are_not_wrapped_around():
    """Without double precision JAX holds whole numbers of 32 bits."""
    with jax.enable_x64(False):
        stiffness = jc.Contact(1.0, np.array([140_000_000_000])).stiffness
        assert stiffness.dtype == np.float32
        np.testing.assert_allclose(stiffness, 1.4e11, rtol=1e-6)
        assert jc.Contact(1.0, np.int64(140_000_000_000)).stiffness > 1.3e11


def test_whole_numbers_of_numpy_and_jax_count():
    for whole in (np.int64(4), np.int32(4), jax.numpy.asarray(4), np.array(4)):
        assert jc.Event(max_steps=whole) == jc.Event(max_steps=4)
        assert jc.Rational(degree=whole).below.shape == (4,)
    for tenth in (np.float32(0.125), jax.numpy.asarray(0.125), np.array(0.125)):
        assert jc.Event(rtol=tenth) == jc.Event(rtol=0.125)
        assert jc.Huber(tenth) == jc.Huber(0.125)

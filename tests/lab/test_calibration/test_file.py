"""Saved calibrations are restored to the last bit, and every fault of a file is named."""

import dataclasses
import io
import json

import numpy as np
import pytest

import jaxcontact as jc
from tests.lab.simulate import recording

V = np.geomspace(0.5, 4.0, 14)
E = 0.9 - 0.03 * np.log(V) + 0.004 * np.random.default_rng(3).standard_normal(14)


@pytest.fixture(scope="module")
def calibration():
    table = jc.read_recording(velocity=V, restitution=E)
    return jc.calibrate(table, laws="kuwabara_kono", mass=1 / 3, stiffness=1e7 / 3)


@pytest.fixture
def saved(calibration, tmp_path):
    path = tmp_path / "ball.json"
    calibration.save(path)
    return path


def assert_equal(loaded, made):
    """A choice comes back without its fits."""
    if dataclasses.is_dataclass(loaded):
        for field in dataclasses.fields(loaded):
            assert getattr(loaded, field.name) == getattr(made, field.name)
    else:
        assert loaded == made


def test_every_number_comes_back_to_the_last_bit(calibration, saved):
    loaded = jc.load_calibration(saved)
    assert isinstance(loaded.law, jc.KuwabaraKono) and loaded.law.tension
    assert loaded.law.A == calibration.law.A
    assert loaded.contact.mass == 1 / 3 and loaded.contact.stiffness == 1e7 / 3
    for field in dataclasses.fields(loaded):
        if field.name not in ("law", "contact"):
            assert_equal(getattr(loaded, field.name), getattr(calibration, field.name))
    before = jc.impact(calibration.law, calibration.contact, V).restitution
    assert np.array_equal(jc.impact(loaded.law, loaded.contact, V).restitution, before)
    again = saved.with_name("again.json")
    calibration.save(again)
    assert again.read_bytes() == saved.read_bytes()


def test_a_file_of_the_version_before_has_no_check(saved):
    data = json.loads(saved.read_text())
    del data["check"], data["stiffness_error"]
    saved.write_text(json.dumps(data | {"format_version": 6}))
    loaded = jc.load_calibration(saved)
    assert loaded.check is None and loaded.pairs


def test_a_recording_with_trials_and_outliers_comes_back(tmp_path):
    text = recording(lambda v: 0.88, 5).replace(",3,5,", ",3,50,", 1)
    result = jc.calibrate(jc.read_recording(io.StringIO(text)), laws="constant_damping")
    result.save(tmp_path / "a.json")
    loaded = jc.load_calibration(tmp_path / "a.json")
    assert loaded.pairs == result.pairs and loaded.by_speed == result.by_speed
    assert_equal(loaded.with_marked, result.with_marked)


def change(data, path, value):
    *way, last = path
    for name in way:
        data = data[name]
    if value is DELETE:
        del data[last]
    else:
        data[last] = value


DELETE = object()

FAULTS = [
    (["format_version"], 1, "format_version must be 6 or 7"),
    (["format_version"], DELETE, "format_version is missing"),
    (["colour"], "red", "colour is unknown; known are law, contact"),
    (["noise", "pink"], 1.0, "noise.pink is unknown; known are relative, reading"),
    (["noise", "relative"], DELETE, "noise.relative is missing"),
    (["noise", "relative"], "small", "noise.relative must be a number, but is 'small'"),
    (["noise", "relative"], True, "noise.relative must be a number, but is True"),
    (["noise", "relative"], None, "noise.relative must be a number, but is None"),
    (["pairs", 3, "velocity"], float("nan"), "holds NaN"),
    (["pairs", 3, "velocity"], 10**400, r"pairs\[3\].velocity must be finite"),
    (["pairs", 3, "rows"], 7, r"pairs\[3\].rows must be a list, but is 7"),
    (["pairs", 3, "marked"], 0, r"pairs\[3\].marked must be of type bool, but is 0"),
    (["law", "name"], "magic", "law.name must be one of .*, but is 'magic'"),
    (["law", "parameters", "A"], DELETE, "law.parameters.A is missing"),
    (["law", "parameters", "A"], -1.0, "law is out of range: .*`A` must be in"),
    (["law", "parameters", "e"], 0.5, "law.parameters.e is unknown; known are A"),
    (["law", "tension"], "yes", "law.tension must be true or false, but is 'yes'"),
    (["contact", "mass"], 0.0, "contact is out of range: .*`mass` must be in"),
    (["standard_errors", "A"], "x", "standard_errors.A must be a number"),
    (["choice"], [], r"choice must be an object, but is \[\]"),
]


@pytest.mark.parametrize(("path", "value", "message"), FAULTS)
def test_a_fault_is_named(saved, path, value, message):
    data = json.loads(saved.read_text())
    change(data, path, value)
    saved.write_text(json.dumps(data))
    with pytest.raises(ValueError, match=f"ball.json: .*{message}"):
        jc.load_calibration(saved)


@pytest.mark.parametrize(
    ("text", "message"), [("{", "is not JSON"), ("[1, 2]", "format_version is missing")]
)
def test_what_is_no_json_is_refused(text, message, tmp_path):
    (tmp_path / "ball.json").write_text(text)
    with pytest.raises(ValueError, match=f"ball.json: {message}"):
        jc.load_calibration(tmp_path / "ball.json")
    with pytest.raises(FileNotFoundError):
        jc.load_calibration(tmp_path / "none.json")

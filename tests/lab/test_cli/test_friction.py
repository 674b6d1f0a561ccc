"""`jaxcontact calibrate` of a table of oblique impacts."""

import importlib.resources
import json

import jax
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact.lab.calibration.calibrate_friction import is_oblique, read_rebounds

SHIPPED = str(importlib.resources.files("jaxcontact.data") / "oblique_rebounds.csv")
HEIGHTS = str(importlib.resources.files("jaxcontact.data") / "rebound_heights.csv")


def written(tmp_path, text):
    path = tmp_path / "table.csv"
    path.write_text(text)
    return str(path)


def test_the_shipped_table():
    table = read_rebounds(SHIPPED)
    assert is_oblique(SHIPPED) and not is_oblique(HEIGHTS) and not is_oblique("nothing.csv")
    assert np.allclose(np.hypot(table.normal, table.tangential), 3.9)
    assert table.outcomes.keys() == {"tangential_restitution", "rebound_spin"}
    assert table.restitution is None and len(table.normal) == 15


@pytest.mark.parametrize(
    "text",
    [
        "angle of impact [deg], speed (m/s), v_t'/v_t, e, ball\n30, 2, 0.7, 0.9, a\n",
        "theta (rad), speed (cm/s), vt' (m/s), cor\n0.5235987755982988, 200, 0.7, 0.9\n",
        "v_n (m/s), v_t (m/s), et, e\n1.7320508075688772, 1, 0.7, 0.9\n",
        "speed, tangential speed, et, e\n2, 1, 0.7, 0.9\n",
        "angle (deg), vn, et, en\n30, 1.7320508075688772, 0.7, 0.9\n",
    ],
)
def test_headings_and_units(tmp_path, text):
    path = written(tmp_path, text)
    assert is_oblique(path) and ("ball" not in text or is_oblique(path, columns="ball=5"))
    table = read_rebounds(path)
    assert table.normal == pytest.approx([3**0.5]) and table.tangential == pytest.approx([1.0])
    assert table.outcomes == {"tangential_restitution": pytest.approx([0.7])}
    assert table.restitution == pytest.approx(0.9)


def test_spins_and_angles_after(tmp_path):
    text = "angle (deg),speed,rebound angle (deg),spin (rpm)\n30,2,20,60\n40,2,,\n"
    table = read_rebounds(written(tmp_path, text))
    assert table.outcomes["rebound_angle"][0] == pytest.approx(np.radians(20))
    assert table.outcomes["rebound_spin"][0] == pytest.approx(2 * np.pi)
    assert np.isnan(table.outcomes["rebound_spin"][1])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("angle,speed,et\n30,2,0.7\n", "has no unit, deg or rad"),
        ("angle (deg),speed,et\n95,2,0.7\n", "an angle of impact of 95 degrees"),
        ("angle (deg),et\n30,0.7\n", "does not say how bodies come in"),
        ("angle (deg),speed\n30,2\n", "has no outcome of oblique impacts"),
        ("speed,tangential speed,et\n2,3,0.7\n", "tangential speeds above the speed"),
    ],
)
def test_tables_that_say_too_little(tmp_path, text, message):
    with pytest.raises(jc.RecordingError, match=message):
        read_rebounds(written(tmp_path, text))


def test_a_result_prints_mu_first_and_writes_its_numbers():
    laws = {"rigid Coulomb": jc.RigidCoulomb(0.3), "Walton": jc.WaltonFriction(0.3, 0.1)}
    how = {"restitution": 1.0, "tangential_ratio": 0.83, "radius": 0.0025, "friction": laws}
    with jax.enable_x64(False):
        found = jc.calibrate_friction(SHIPPED, **how)
    assert found.choice.fits["Walton"].problem.predict.contact.tangential_ratio == 0.83
    assert repr(found).startswith("mu = 0.09") and "e = 1; read as angle = " in repr(found)
    assert found.converged and isinstance(found.friction, jc.WaltonFriction)
    numbers = json.loads(found.to_json())
    best = numbers["laws"][numbers["best"]]
    assert numbers["best"] == "Walton" and best["parameters"].keys() == {"mu", "beta0"}


def test_a_recording_of_oblique_impacts_names_the_function_that_reads_it():
    with pytest.raises(jc.RecordingError, match="for oblique impacts use `calibrate_friction`"):
        jc.read_recording(SHIPPED)
    with pytest.raises(jc.RecordingError, match="no known column"):
        jc.read_recording({"a": [1, 2, 3]})

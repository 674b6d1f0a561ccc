"""Friction laws from oblique impacts: published and synthetic ones, files, bad input by name."""

import importlib.resources
import json

import jax
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact.lab.calibration.calibrate_friction import is_oblique, read_rebounds
from jaxcontact.lab.oblique.choose_friction import candidates_of
from jaxcontact.lab.oblique.fit_oblique import NOTE
from jaxcontact.lab.oblique.measurements import measurements
from tests.lab.sources import written

ALUMINA = jc.Material(380e9, 0.23, 4000.0)
GLASS = jc.Material(70e9, 0.25)
CONTACT = jc.Contact.sphere_plane(0.0025, ALUMINA, GLASS)
BODIES = jc.RoundBodies(radius=0.0025)
LAW = jc.Hertz()
TABLE, HEIGHTS = (
    str(importlib.resources.files("jaxcontact.data") / f"{name}.csv")
    for name in ("oblique_rebounds", "rebound_heights")
)

ANGLE, SPEED, RATIO, SPIN = np.genfromtxt(TABLE, delimiter=",", skip_header=1).T
KHARAZ = {
    "velocity": SPEED * np.cos(np.radians(ANGLE)),
    "tangential_velocity": SPEED * np.sin(np.radians(ANGLE)),
    "bodies": BODIES,
}
START = jc.RigidCoulomb(2.0)
LAWS = {"rigid Coulomb": START, "Walton": jc.WaltonFriction(1.0, 0.0)}
OUTCOMES = {"tangential_restitution": RATIO, "rebound_spin": SPIN}

NOTHING_FITTED = {
    "rigid": (jc.RigidCoulomb(0.092), 0.054, 73),
    "Walton": (jc.WaltonFriction(0.092, 0.44), 0.096, 26),
    "Maw-Barber-Fawcett": (jc.MawBarberFawcett(0.092), 0.0135, 21),
    "displacement": (jc.SpringSlider(0.092, form="displacement"), 0.117, 40),
    "force": (jc.SpringSlider(0.092, form="force"), 0.086, 38),
    "rescaled": (jc.SpringSlider(0.092, form="rescaled"), 0.056, 38),
}
"""The rms errors of v_t'/v_t and of the spin in rad/s, computed outside of this package."""


def off(friction):
    """The rms errors of v_t'/v_t and of the spin by a friction law on the published table."""
    hit = jc.oblique_impact(LAW, CONTACT, **KHARAZ, friction=friction)
    ratio = hit.tangential_velocity / KHARAZ["tangential_velocity"] - RATIO
    return [float(np.sqrt(np.nanmean(np.square(x)))) for x in (ratio, -hit.spin[0] - SPIN)]


@pytest.mark.slow("displacement", "rescaled", reason="the springs once more in another form")
@pytest.mark.parametrize("name", NOTHING_FITTED)
def test_published_rebounds_with_nothing_fitted(name):
    friction, ratio, spin = NOTHING_FITTED[name]
    assert off(friction) == [pytest.approx(ratio, abs=7e-4), pytest.approx(spin, abs=0.7)]


@pytest.fixture(scope="module")
def choice():
    return jc.choose_friction(LAW, CONTACT, **KHARAZ, **OUTCOMES)


def test_published_rebounds_choose_a_law(choice):
    assert choice.best == "Maw-Barber-Fawcett"
    fit = choice.fits[choice.best]
    assert fit.params.mu == pytest.approx(0.092, abs=4 * fit.standard_errors["mu"])
    assert repr(choice).startswith("mu = 0.09") and choice.best in choice.headline
    rigid = choice.fits["rigid Coulomb"]
    assert rigid.adequate is False and "does not describe the data" in repr(choice)
    assert off(choice.friction())[1] < off(choice.friction("rigid Coulomb"))[1] / 2


def test_one_fit_is_that_of_the_choice(choice):
    """Up to the noise of the columns, which the choice takes from its best law."""
    fit = jc.fit_oblique(LAW, CONTACT, **KHARAZ, **OUTCOMES, friction=START)
    other = choice.fits["rigid Coulomb"]
    assert float(fit.params.mu) == pytest.approx(
        float(other.params.mu), abs=other.standard_errors["mu"]
    )
    assert fit.notes[-1] == "6 of 15 impacts slid throughout"


E_LAW = jc.HuGuo(e=0.8)
STEEP = np.radians(np.linspace(4, 64, 12))
SPEEDS = {"velocity": 2 * np.cos(STEEP), "tangential_velocity": 2 * np.sin(STEEP)}


def synthetic(truth, noise, seed):
    hit = jc.oblique_impact(E_LAW, CONTACT, **SPEEDS, friction=truth)
    scatter = np.random.default_rng(seed).normal(size=12)
    return np.asarray(hit.tangential_velocity) / SPEEDS["tangential_velocity"] + noise * scatter


TRUTHS = {
    "rigid": (jc.RigidCoulomb, [0.17], [2.0]),
    "Walton": (jc.WaltonFriction, [0.17, 0.4], [1.0, -0.6]),
    "Maw-Barber-Fawcett": (jc.MawBarberFawcett, [0.17, 0.82], [1.0, 0.9]),
}


@pytest.mark.parametrize("name", TRUTHS)
def test_truths_return_from_far_starts_within_their_errors(name):
    """Every fit converges, also where the lowest loss is at a jump between stick and slip."""
    law, values, start = TRUTHS[name]
    deviations, jumps = [], 0
    for seed in range(12):
        how = SPEEDS | {"tangential_restitution": synthetic(law(*values), 0.02, seed)}
        fit = jc.fit_oblique(E_LAW, CONTACT, **how, friction=law(*start))
        assert fit.converged
        jumps += NOTE in fit.notes
        deviations.append((fit.values - values) / fit.errors)
    # 1.0 to 1.2 were seen over 60 draws.
    assert np.all(np.sqrt(np.mean(np.square(deviations), axis=0)) < 1.5)
    assert (jumps > 0) == (name == "Walton") or name == "rigid"


def test_exact_data_of_several_columns_with_missing_readings():
    truth = jc.WaltonFriction(0.17, 0.4)
    hit = jc.oblique_impact(E_LAW, CONTACT, **SPEEDS, friction=truth, bodies=BODIES)
    along, spin = np.array(hit.tangential_velocity), -np.array(hit.spin[0])
    ratio = along / SPEEDS["tangential_velocity"]
    angle = np.arctan(along / np.asarray(SPEEDS["velocity"] * hit.normal.restitution))
    ratio[::2], angle[1::3], spin[2::4] = np.nan, np.nan, np.nan
    how = SPEEDS | {"bodies": BODIES, "friction": jc.WaltonFriction(0.5, 0.0), "noise": "common"}
    how |= {"tangential_restitution": ratio, "rebound_angle": angle, "rebound_spin": spin}
    # In single precision it is fitted in double.
    with jax.enable_x64(False):
        contact = jc.Contact.sphere_plane(0.0025, ALUMINA, GLASS)
        fit = jc.fit_oblique(E_LAW, contact, **how)
    assert np.allclose(fit.values, [0.17, 0.4], rtol=1e-6)
    assert np.count_nonzero(np.isfinite(fit.data)) == 6 + 8 + 9


def test_sliding_alone_determines_nothing_but_mu():
    ratio = synthetic(jc.RigidCoulomb(0.05), 0.01, 3)
    ratio[:6] = np.nan
    how = SPEEDS | {"tangential_restitution": ratio, "friction": LAWS}
    found = jc.choose_friction(E_LAW, CONTACT, **how)
    assert found.best == "rigid Coulomb" and found.rivals == ("Walton",)
    assert "do not distinguish it from Walton" in found.verdict
    assert "6 of 6 impacts slid throughout: only μ follows" in repr(found)
    assert "at an angle of impact of" in found.next_measurement
    fit = found.fits["Walton"]
    assert np.isnan(fit.standard_errors["beta0"]) and fit.standard_errors["mu"] < 0.005
    assert found.friction().mu == pytest.approx(0.05, abs=0.01)


def test_laws_that_do_not_apply_are_left_out():
    """The table of Maw-Barber-Fawcett needs n = 3/2."""
    columns = dict.fromkeys(OUTCOMES | {"rebound_angle": None}, (None, None))
    columns |= {"tangential_restitution": (np.full(12, 0.7), None)}
    there = measurements(E_LAW, jc.Contact(1.0, 1.0, 2.0), *SPEEDS.values(), None, columns)
    laws, left_out = candidates_of(None, there)
    assert "rigid Coulomb" in laws and "Walton" in laws
    assert "`MawBarberFawcett` for a normal force other" in left_out["Maw-Barber-Fawcett"]


FEW = {name: x[:3] for name, x in SPEEDS.items()}
CHOSEN = "`friction` must be None or a dict of at least two"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tangential_restitution": None}, "`rebound_angle` or `rebound_spin` must be given"),
        ({"velocity": -SPEEDS["velocity"]}, "`velocity` must be in"),
        ({"tangential_velocity": -SPEEDS["velocity"]}, "`tangential_velocity` must be in"),
        ({"tangential_velocity": 0 * SPEEDS["velocity"]}, "must be NaN where"),
        ({"tangential_restitution": np.full(12, 70.0)}, "`tangential_restitution` must be in"),
        ({"rebound_angle": np.full(12, 40.0)}, "Is it in degrees"),
        ({"rebound_spin": np.full(12, 100.0)}, "`bodies` must have a radius"),
        ({"rebound_spin": np.full(12, -100.0), "bodies": BODIES}, "then change the sign"),
        ({"sigma_rebound_angle": 0.1}, "`sigma_rebound_angle` must be None without"),
        ({"bodies": jc.RoundBodies(radius=0.1, mass=1.0)}, "effective mass"),
        *(({"friction": laws}, CHOSEN) for laws in ({"one": START}, {"one": START, "two": 3})),
        ({"friction": [START, START]}, CHOSEN),
        (
            FEW | {"tangential_restitution": np.full(3, 0.7), "friction": LAWS},
            r"at least 5 readings .* but holds 3; `fit_oblique`",
        ),
    ],
)
def test_bad_input_is_named(change, message):
    given = SPEEDS | {"friction": START, "tangential_restitution": np.full(12, 0.7)} | change
    one = isinstance(given["friction"], jc.RigidCoulomb)
    with pytest.raises(ValueError, match=message):
        (jc.fit_oblique if one else jc.choose_friction)(E_LAW, CONTACT, **given)


def test_the_shipped_table():
    table = read_rebounds(TABLE)
    assert is_oblique(TABLE) and not is_oblique(HEIGHTS) and not is_oblique("nothing.csv")
    assert np.allclose(np.hypot(table.normal, table.tangential), 3.9)
    assert table.outcomes.keys() == {"tangential_restitution", "rebound_spin"}
    assert table.restitution is None and len(table.normal) == 15
    with pytest.raises(jc.RecordingError, match="for oblique impacts use `calibrate_friction`"):
        jc.read_recording(TABLE)
    with pytest.raises(jc.RecordingError, match="no known column"):
        jc.read_recording({"a": [1, 2, 3]})


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
    path = written(tmp_path, "table.csv", text)
    assert is_oblique(path) and ("ball" not in text or is_oblique(path, columns="ball=5"))
    table = read_rebounds(path)
    assert table.normal == pytest.approx([3**0.5]) and table.tangential == pytest.approx([1.0])
    assert table.outcomes == {"tangential_restitution": pytest.approx([0.7])}
    assert table.restitution == pytest.approx(0.9)


def test_spins_and_angles_after(tmp_path):
    text = "angle (deg),speed,rebound angle (deg),spin (rpm)\n30,2,20,60\n40,2,,\n"
    table = read_rebounds(written(tmp_path, "table.csv", text))
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
        read_rebounds(written(tmp_path, "table.csv", text))


def test_a_result_prints_mu_first_and_writes_its_numbers():
    laws = {"rigid Coulomb": jc.RigidCoulomb(0.3), "Walton": jc.WaltonFriction(0.3, 0.1)}
    how = {"restitution": 1.0, "tangential_ratio": 0.83, "radius": 0.0025, "friction": laws}
    with jax.enable_x64(False):
        found = jc.calibrate_friction(TABLE, **how)
    assert found.choice.fits["Walton"].problem.predict.contact.tangential_ratio == 0.83
    assert repr(found).startswith("mu = 0.09") and "e = 1; read as angle = " in repr(found)
    assert found.converged and isinstance(found.friction, jc.WaltonFriction)
    numbers = json.loads(found.to_json())
    best = numbers["laws"][numbers["best"]]
    assert numbers["best"] == "Walton" and best["parameters"].keys() == {"mu", "beta0"}

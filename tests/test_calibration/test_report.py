"""The report says what it must, and its dictionary is strict JSON."""

import json
import math

import numpy as np
import pytest

from jaxcontact._calibration import Estimate, calibrate, report, to_dict
from jaxcontact._calibration._report import with_error
from jaxcontact._flight import Drag
from jaxcontact._measurements import read_recording
from tests.test_measurements.sources import opened

DRAG = Drag(mass=0.0027, radius=0.02, coefficient=0.5)


@pytest.fixture(scope="module")
def blue():
    return calibrate(read_recording())


def test_every_marked_pair_is_listed_with_its_rows(blue):
    text = report(blue)
    flagged = np.flatnonzero(blue.outliers.flagged)
    assert len(flagged) == 23
    for k in flagged:
        assert f"  {blue.pairs.first_row[k]}, {blue.pairs.second_row[k]} " in text
    assert "23 of 294 pairs" in text
    assert "without (271)" in text
    assert "with (294)" in text


def test_what_the_issue_is_about_is_said(blue):
    text = " ".join(report(blue).split())
    for words in (
        "is left in",
        "--mass --radius --drag-coefficient",
        "e(v) fixes only A (K/m)^(2/5)",
        "e(v) fixes only c/K",
        "standard errors by trial",
        "converged yes",
        "shipped with the package",
        "a free line (no law)",
    ):
        assert words in text
    assert max(len(line) for line in report(blue).splitlines()) <= 110


def test_drag_that_was_taken_out_is_said():
    result = calibrate(read_recording(ball="pingpong"), law="constant_damping", drag=DRAG)
    text = " ".join(report(result).split())
    assert "taken out of the flights: quadratic, terminal speed 8.37 m/s" in text
    assert to_dict(result)["flight"]["drag"]["coefficient"] == 0.5


def test_a_trend_with_the_drag_left_in_comes_with_a_warning(blue):
    caution = "may be drag, not the contact"
    ping, law = read_recording(ball="pingpong"), "constant_damping"
    raw = calibrate(ping, law=law)
    clear = calibrate(ping, law=law, drag=DRAG)
    assert caution in report(raw)
    assert caution in to_dict(raw)["caution"]
    assert caution not in report(clear)
    assert to_dict(clear)["caution"] is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "velocity,restitution\n"
            + "".join(f"{v},{0.9 + 0.002 * (-1) ** v}\n" for v in range(1, 13)),
            "by row (sandwich)",
        ),
        (
            "ball,drop_height_m,trial,rebound_height_m\n"
            + "".join(f"a,{h},1,{0.7 * h + 0.01 * (-1) ** h}\n" for h in range(1, 11)),
            "by drop height (cluster-robust sandwich)",
        ),
        (
            "ball,drop_height_m,trial,rebound_height_m\n"
            + "".join(f"a,{h},1,{0.7 * h + 0.01 * (-1) ** h}\n" for h in range(1, 7)),
            "fewer than 8 drop heights",
        ),
    ],
)
def test_how_the_standard_errors_were_found_is_said(text, words):
    result = calibrate(read_recording(opened(text)), law="constant_damping")
    assert words in " ".join(report(result).split())
    assert words in to_dict(result)["standard_errors"]


def test_a_table_has_no_flights():
    rows = "".join(f"{v},{0.9 - 0.01 * v + 0.002 * (-1) ** v}\n" for v in range(1, 9))
    result = calibrate(read_recording(opened("velocity,restitution\n" + rows)))
    text = report(result)
    assert "plays no part" in text
    assert "none of 8 pairs" in text
    assert "With and without" not in text


def test_the_dictionary_is_strict_json_and_whole(blue):
    data = json.loads(json.dumps(to_dict(blue, {"ball": "blue"}), allow_nan=False))
    assert data["options"] == {"ball": "blue"}
    assert set(data["versions"]) == {"jaxcontact", "jax", "optax", "numpy"}
    marked = [pair for pair in data["pairs"] if pair["marked"]]
    assert len(data["pairs"]) == 294
    assert len(marked) == data["outlier_rule"]["marked"] == 23
    assert all(len(pair["rows"]) == 2 and pair["may_be"] for pair in marked)
    assert [fit["law"] for fit in data["without_marked"]["fits"]] == [
        "exact",
        "kuwabara_kono",
        "constant_damping",
    ]
    estimate = data["without_marked"]["fits"][0]["estimates"][0]
    assert math.isclose(estimate["value"], blue.kept.fits[0].estimates[0].value)
    assert data["converged"] is True


def test_what_is_not_finite_becomes_null():
    rows = "".join(f"2.0,{e}\n" for e in (0.88, 0.89, 0.87, 0.885, 0.875))
    result = calibrate(read_recording(opened("velocity,restitution\n" + rows)))
    data = json.loads(json.dumps(to_dict(result), allow_nan=False))
    assert data["without_marked"]["line"]["slope_standard_error_s_m"] is None
    assert "only one speed" in report(result)


@pytest.mark.parametrize(
    ("value", "error", "unit", "text"),
    [
        (0.87991, 0.00084, "", "0.87991 ± 0.00084"),
        (89683.4, 1940.2, "N", "8.97e+04 ± 1.9e+03 N"),
        (9.589e-6, 6.7e-8, "s", "9.589e-06 ± 6.7e-08 s"),
        (0.5, None, "s/m", "0.5 s/m (not determined)"),
        (0.5, 0.0, "", "0.5 ± 0"),
        (0.021, 0.5, "", "0.02 ± 0.50"),
    ],
)
def test_digits_follow_the_error(value, error, unit, text):
    assert with_error(Estimate("x", value, error, unit)) == text

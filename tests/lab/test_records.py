"""Impacts in records of force and acceleration, against simulated ones with known truth."""

import functools
import io
import json

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

import jaxcontact as jc
from benchmarks.lab.records import draw, found_in, impact, read
from jaxcontact.lab.calibration.report import impacts
from jaxcontact.lab.cli import main
from jaxcontact.lab.signals import noise_of

MASS, STIFFNESS, DAMPING = 0.05, 2e6, 0.15
RATE = 50e3
SPEEDS = 2.0, 1.5, 1.1, 0.8
STARTS = 0.05, 0.25, 0.4, 0.5

FEW_ERRORS = 4.0  # standard errors: one draw in 16,000 is farther off, and these draws are fixed


@functools.cache
def pieces() -> list[tuple[np.ndarray, ...]]:
    return [impact(MASS, STIFFNESS, DAMPING, speed) for speed in SPEEDS]


def plate(count: int = 4, *, noise: float = 0.5, seed: int = 0, long: float = 0.6) -> tuple:
    """Times in s and forces in N of impacts, the first of 132 N, on a plate without an offset."""
    time = np.arange(round(long * RATE)) / RATE
    force = noise * np.random.default_rng(seed).normal(size=time.size)
    for start, (t, f, _) in list(zip(STARTS, pieces(), strict=True))[:count]:
        force += np.interp(time - start, t, f, left=0, right=0)
    return time, force


def why(time: np.ndarray, force: np.ndarray) -> list[str]:
    """Why contacts of a record are doubtful."""
    return [one.why for one in jc.read_recording(time=time, force=force).records[0].trace.doubtful]


def test_impacts_are_found_where_they_are():
    time, force = plate()
    found = jc.read_recording(time=time, force=force).records
    touches = [one.trace.time[0] + one.touch * one.trace.step for one in found]
    # At half height: a tenth of a contact of 2.6 ms.
    np.testing.assert_allclose(touches, STARTS, atol=3e-4)
    assert [one.number for one in found] == [1, 2, 3, 4]
    assert found[0].trace.noise == pytest.approx(0.5, rel=0.05)


def test_a_file_is_read_as_it_was_saved():
    time, force = plate()
    lines = (f"{1e3 * t:.2f};{-1e-3 * (f + 7):.6f};0" for t, f in zip(time, force, strict=True))
    text = "\n".join(["abs time (ms);Fz [kN];Fx [kN]", *lines]).replace(".", ",")
    recording = jc.read_recording(io.StringIO(text))
    assert recording.layout.name == "force" and len(recording) == 4
    said = "; ".join(recording.notes)
    assert 'time = "abs time (ms)" / 1000' in said and 'force = "Fz [kN]" * 1000' in said
    assert "sign reversed" in said and "decimal commas" in said
    reading = recording.records[0].reading
    assert reading.max() == pytest.approx(max(pieces()[0][1]), abs=2.5)


def test_a_rate_stands_for_the_times_and_g_is_a_unit():
    time, force = plate(1, long=0.2)
    by_time = jc.read_recording(time=time, force=force).records[0]
    by_rate = jc.read_recording(force=force, rate=RATE).records[0]
    np.testing.assert_allclose(by_rate.time, by_time.time, rtol=1e-12)
    with pytest.raises(ValueError, match="is it in kHz"):
        jc.read_recording(force=force, rate=50)
    with pytest.raises(ValueError, match="`rate` must be None for rows of speed and restitution"):
        jc.read_recording({"v": [1.0], "e": [0.5]}, rate=RATE)
    in_si = jc.read_recording(time=time, acceleration=force / MASS)
    in_g = jc.read_recording({"t [s]": time, "a [g]": force / MASS / 9.80665})
    one, other = (recording.records[0].reading for recording in (in_g, in_si))
    np.testing.assert_allclose(one, other, atol=1e-9, rtol=1e-12)


def test_what_cannot_be_used_is_refused():
    time, force = plate(1, long=0.2)
    noise = np.random.default_rng(3).normal(size=time.size)
    columns: dict
    for columns, said in (
        ({"time": time, "force": noise}, "no impact was found: nothing exceeds the noise"),
        ({"time": time, "force": 0 * time}, "is 0 everywhere"),
        ({"time": time[::25], "force": force[::25]}, "only 5 readings of the contact; .*faster"),
        ({"time": time[:20], "force": force[:20]}, "20 readings, too few"),
        ({"time": 1e3 * time, "force": force}, r"is it in ms\? write the unit"),
        ({"time": np.round(time, 4), "force": force}, "too few digits.*`rate`"),
        ({"Fz (N)": force}, "or give `rate`, the readings per second"),
        ({"time": time, "force": force, "rate": RATE}, "already gives the times; omit `rate`"),
        ({"t [s]": time, "az": force}, r"no unit, m/s² or g; .*'az \[g\]'"),
        ({"time": np.delete(time, slice(99, 300)), "force": force[201:]}, "s after the reading"),
        ({"time": time, "ax [g]": force, "ay [g]": force}, 'choose one .*"acceleration=2"'),
        ({"time": time, "Fx": force, "Fy": force}, "force.*is missing"),
        ({"time": time, "force": [*force[:-1], "x"]}, "row 10000.*'x' is not a number"),
        ({"time": time, "force": [*force[:-1], None]}, "row 10000.*is empty"),
    ):
        rate = columns.pop("rate", None)
        with pytest.raises(jc.RecordingError, match=said):
            jc.read_recording(columns, rate=rate)


def test_doubtful_contacts_are_listed_and_left_out():
    time, force = plate(2)
    t, f, _ = pieces()[0]

    def with_one(start: float, scale: float = 1.0) -> np.ndarray:
        return force + scale * np.interp(time - start, t, f, left=0, right=0)

    assert why(time, force) == []
    assert why(time, with_one(0.4) + with_one(0.4019) - force) == ["a double contact"] * 2
    cut_off = with_one(time[-1] - 1.2e-3)
    assert why(time, cut_off) == ["cut off by the end of the record"]
    # A ringing plate: a decaying oscillation of 300 Hz.
    since = time - 0.4
    ring = np.where(since > 0, 60 * np.sin(1885 * since) * np.exp(-since / 3e-3), 0)
    assert any("ringing" in one for one in why(time, force + ring))
    step = force + np.where(time > 0.4012, 30.0, 0.0)
    assert "the level after it differs from that before" in why(time, step + with_one(0.4) - force)
    # A ball that comes to rest on the plate is not an impact, and its weight not an offset.
    lies = force + np.where(time > 0.45, MASS * 9.81, 0)
    assert why(time, lies) == [] and len(jc.read_recording(time=time, force=lies)) == 2


def test_hum_is_taken_out():
    time, force = plate(2)
    hum = 6 * np.sin(2 * np.pi * 49.93 * time + 1) + 2 * np.sin(2 * np.pi * 99.86 * time)
    recording = jc.read_recording(time=time, force=force + hum)
    assert any("hum of 49.9 Hz" in note or "hum of 50.0 Hz" in note for note in recording.notes)
    clean = jc.read_recording(time=time, force=force)
    for one, other in zip(recording.records, clean.records, strict=True):
        start = max(one.start, other.start)
        stop = min(one.stop, other.stop)
        pair = [part.trace.value[start:stop] for part in (one, other)]
        # At most a third of the noise of one reading remains.
        assert np.ptp(pair[0] - pair[1]) < 0.5


def test_noise_is_that_of_the_quiet_parts():
    random = np.random.default_rng(5)
    noise = random.normal(size=20_000)
    assert noise_of(noise) == pytest.approx(1, rel=0.05)
    noise[5000:12_000] += 100 * np.sin(np.arange(7000) / 9)
    assert noise_of(noise) == pytest.approx(1, rel=0.1)
    # With steps far larger than the noise most readings are equal.
    steps = np.where(np.arange(5000) % 97 == 0, 1.0, 0.0)
    assert noise_of(steps) == pytest.approx(12**-0.5, rel=0.2)


@functools.cache
def calibrated() -> jc.Calibration:
    time, force = plate()
    recording = jc.read_recording(time=time, force=force + 7)
    return jc.calibrate(recording, mass=MASS, laws="constant_damping")


@pytest.mark.slow(reason="a fit to each impact of a record, 22 s of CPU")
def test_each_impact_and_the_law_come_back():
    found = calibrated()
    assert found.converged
    for one, speed, (t, f, after) in zip(found.impact_fits, SPEEDS, pieces(), strict=True):
        for outcome, truth in (
            (one.velocity, speed), (one.restitution, after / speed), (one.duration, t[-1]),
            (one.max_force, f.max()), (one.stiffness, STIFFNESS),
        ):  # fmt: skip
            assert abs(outcome.value - truth) < FEW_ERRORS * outcome.error < 0.1 * truth
    assert isinstance(found.law, jc.ConstantDamping)
    estimates = {one.name: one for one in found.choice.law_fit("constant c").estimates}
    for name, truth in (("c/K", DAMPING), ("K", STIFFNESS)):
        one = estimates[name]
        assert one.standard_error is not None
        assert abs(one.value - truth) < FEW_ERRORS * one.standard_error < 0.2 * truth
    assert found.choice.best == "constant c"
    assert float(found.contact.stiffness) == pytest.approx(estimates["K"].value)


def test_the_report_tells_of_the_impacts(tmp_path):
    found = calibrated()
    text = found.report()
    assert "Impacts    one by one" in text and "agrees with the n = 1.5" in text
    assert "delivers a constant e of 0." in text
    (line,) = (one for one in text.splitlines() if one.startswith("K = ("))
    value, error = (float(one) for one in line[5:].partition(")")[0].split(" ± "))
    assert abs(value - STIFFNESS) < FEW_ERRORS * error / 1.96 and line.endswith("α δ'/v0)")
    assert impacts(found)[1].html().count("<tr>") == 1 + len(SPEEDS)
    found.save(tmp_path / "plate.json")
    loaded = jc.load_calibration(tmp_path / "plate.json")
    assert loaded.impacts == found.impacts and loaded.given == ("mass", "stiffness")
    assert jc.export(loaded, engine="drake").parameters["hunt_crossley_dissipation"] > 0


def test_one_impact_gives_e_and_the_stiffness():
    time, force = plate(1, long=0.2, seed=2)
    found = jc.calibrate(jc.read_recording(time=time, acceleration=force / MASS), mass=MASS)
    assert found.converged and found.choice.best == "constant e" and not found.choice.sure
    e = found.choice.constant
    truth = pieces()[0][2] / SPEEDS[0]
    assert e.standard_error is not None
    assert abs(e.value - truth) < FEW_ERRORS * e.standard_error < 0.05
    assert "1 impact cannot distinguish laws" in found.report()
    # The e of the impact, with the error of its readings.
    (one,) = found.impact_fits
    assert f"  {one.restitution.value:.4f} ± {one.restitution.error:.4f}" in repr(found)


@pytest.mark.slow(reason="a fit to a record of the indentation, 34 s of CPU")
def test_an_indentation_tells_speed_and_stiffness():
    # The indentation follows from SciPy's force by two integrations.
    t, f, after = pieces()[0]
    speed = SPEEDS[0] - cumulative_trapezoid(f, t, initial=0) / MASS
    depth = cumulative_trapezoid(speed, t, initial=0)
    time = np.arange(-t[-1], 2 * t[-1], t[-1] / 100)
    flown = np.where(time < 0, SPEEDS[0] * time, -after * (time - t[-1]))
    path = np.where((time > 0) & (time < t[-1]), np.interp(time, t, depth), flown)
    path += 5e-3 * depth.max() * np.random.default_rng(6).normal(size=time.size)
    recording = jc.read_recording({"t (ms)": 1e3 * time, "deformation (mm)": 1e3 * path})
    (one,) = jc.calibrate(recording, mass=MASS, laws="exact").impact_fits
    for outcome, truth in (
        (one.velocity, SPEEDS[0]),
        (one.restitution, after / SPEEDS[0]),
        (one.stiffness, STIFFNESS),
    ):
        assert abs(outcome.value - truth) < FEW_ERRORS * outcome.error < 0.05 * truth
    with pytest.raises(jc.RecordingError, match="does not pass zero"):
        jc.read_recording(time=time, indentation=path + 1)


def test_what_a_record_needs_is_said():
    time, force = plate(1, long=0.2)
    lies = force + np.where(time > 0.12, MASS * 9.81, 0)
    recording = jc.read_recording(time=time, force=lies)
    with pytest.raises(ValueError, match=r"`mass` is needed .* its mass is 0\.0[45]"):
        jc.calibrate(recording)
    with pytest.raises(ValueError, match="`stiffness` must be None for a record"):
        jc.calibrate(recording, mass=MASS, stiffness=1e6)
    with pytest.raises(ValueError, match="`exponent` must be None where e is measured"):
        jc.calibrate(jc.read_recording(interval_s=[0.4, 0.3, 0.2]), exponent=1.4)


def test_the_picture(tmp_path):
    both = jc.plot.record(calibrated())
    marks = [line for line in both[0].lines if line.get_marker() == "v"]
    np.testing.assert_allclose(marks[0].get_xdata(), STARTS, atol=3e-4)
    assert len(both[1].lines) == 2 * len(SPEEDS)
    alone = jc.plot.record(jc.read_recording(force=plate(1, long=0.2)[1], rate=RATE))
    assert alone.get_xlabel().startswith("time")
    with pytest.raises(ValueError, match="must be that of force"):
        jc.plot.record(jc.read_recording(interval_s=[0.4]))


def test_the_command(tmp_path, capsys):
    force = plate(1, long=0.2)[1]
    file = tmp_path / "plate.csv"
    file.write_text("Fz (N)\n" + "\n".join(f"{f:.3f}" for f in force) + "\n")
    words = ["calibrate", str(file), "--rate", "50000", "--out", str(tmp_path), "--quiet"]
    assert main(words) == 2
    assert "--mass is needed for a record of force" in capsys.readouterr().err
    assert main([*words, "--mass", "0.05", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["impacts"][0]["velocity"] == pytest.approx(2, rel=0.03)
    assert (tmp_path / "record.png").is_file()


DRAWS, EMPTY = 15, 5


def test_impacts_of_the_study_are_found():
    """A part of benchmarks/lab/records.py without its fits; the whole finds more than 99 %."""
    strong = found = invented = 0
    for k in range(DRAWS):
        truth = draw(np.random.default_rng([7, k]))
        there, _, more = found_in(truth, read(truth))
        strong += int((truth.height >= 10).sum())
        found += int((there & (truth.height >= 10)).sum())
        invented += more > 0
    assert strong > 2 * DRAWS
    assert found >= 0.98 * strong and invented <= 1
    for k in range(EMPTY):
        assert read(draw(np.random.default_rng([8, k]), impacts=False)) is None

"""Bounces in recordings of sound, against simulated ones with known impacts."""

import dataclasses
import functools
import io
import itertools

import numpy as np
import pytest
import soundfile

import jaxcontact as jc
from benchmarks.lab.sound import RATES, Truth, as_wave, constant_e, draw, one_of, summary
from jaxcontact._flight import Flight
from jaxcontact.lab.layouts.intervals import Timing
from jaxcontact.lab.pairs.pairs import scatter_beside
from jaxcontact.lab.recordings import make_pairs, read_columns
from jaxcontact.lab.sound.listening import listen
from tests.lab.sources import refused

CLEAN = 4  # a draw with a clear drop: e = 0.64, 37 dB over the noise
FLIGHTS = 0.4 * 0.75 ** np.arange(4)

STEP = 1e-4  # in s: coarse codings move times by less; measured 2e-5


@functools.cache
def truth() -> Truth:
    return draw(np.random.default_rng([0, CLEAN]))


def times(recording: jc.Recording) -> np.ndarray:
    assert recording.sound is not None
    return np.array([one.time for drop in recording.sound.drops for one in drop])


@functools.cache
def recorded() -> jc.Recording:
    """The clear drop."""
    return jc.read_recording(file_of(truth().samples, truth().rate))


def heard() -> np.ndarray:
    """The times in the clear drop."""
    return times(recorded())


def file_of(samples: np.ndarray, rate: int, coding: str = "PCM_16", kind: str = "WAV"):
    """A file of samples; a text chunk precedes them, as phones write it."""
    stream, channels = io.BytesIO(), 1 if samples.ndim == 1 else samples.shape[1]
    with soundfile.SoundFile(stream, "w", rate, channels, coding, format=kind) as out:
        if samples.size:  # of an empty file libsndfile counts the text wrongly
            out.title = "bounces"
        out.write(samples)
    stream.seek(0)
    return stream


def test_a_drop_is_found_and_its_e_lies_in_the_interval(tmp_path):
    path = tmp_path / "bounce.wav"
    path.write_bytes(as_wave(truth()))
    recording = jc.read_recording(path)
    found = times(recording)
    assert len(found) >= 6
    off = found - truth().time[: len(found)]
    assert np.ptp(off) < STEP and recording.layout.name == "intervals"
    assert "1 drop of" in recording.notes[1]
    calibrated = jc.calibrate(recording, laws="constant_damping")
    fit = calibrated.choice.fits["constant e"]
    low, high = next(iter(fit.interval().values()))
    assert low < truth().e < high and high - low < 1e-3 * truth().e
    # The study fits like `calibrate`.
    mean, half, _ = constant_e(recording)
    np.testing.assert_allclose([low, high], np.exp([mean - half, mean + half]), rtol=1e-6)
    assert calibrated.choice.laws[0].errors_by == "readings"
    assert "known errors of the times" in calibrated.report()


CODINGS = [(coding, "WAV") for coding in ("PCM_U8", "PCM_24", "PCM_32", "FLOAT", "DOUBLE")]
CODINGS += [("PCM_16", "WAVEX"), ("PCM_24", "WAVEX")]


@pytest.mark.parametrize(("coding", "kind"), CODINGS)
def test_every_coding_of_a_wave_gives_the_same_times(coding, kind):
    other = times(jc.read_recording(file_of(truth().samples, truth().rate, coding, kind)))
    count = min(len(heard()), len(other))
    assert count >= 5
    most = STEP if coding == "PCM_U8" else 1e-6
    assert np.max(np.abs(heard()[:count] - other[:count])) < most


def test_the_clearer_channel_is_used():
    noise = 0.3 * np.random.default_rng(0).normal(size=truth().samples.size).clip(-3, 3)
    both = np.stack([noise, truth().samples], axis=1)
    sound = jc.read_recording(file_of(both, truth().rate)).sound
    assert sound is not None and sound.channel == 2


@pytest.mark.parametrize("kind", ["FLAC", "OGG", "MP3"])
def test_other_files_by_soundfile(kind, tmp_path):
    path = tmp_path / "bounce.bin"  # the first bytes decide, not the name
    soundfile.write(path, truth().samples, truth().rate, format=kind)
    other = times(jc.read_recording(path))
    assert len(other) >= 5
    # Lossy codecs delay all samples equally.
    assert np.ptp(other[:5] - heard()[:5]) < STEP


def test_without_soundfile_the_message_says_what_to_do(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "soundfile", None)
    refused(r"is FLAC, which needs soundfile \(pip install", io.BytesIO(b"fLaC" + bytes(100)))


def test_several_drops_in_one_file_are_trials():
    one, two = (draw(np.random.default_rng([0, k])) for k in (CLEAN, 6))
    assert one.rate == two.rate
    both = np.concatenate([one.samples, two.samples])
    recording = jc.read_recording(file_of(both, one.rate))
    assert {record.trial for record in recording.records} == {"1", "2"}
    assert "2 drops of" in recording.notes[1]


def test_what_holds_no_bounces_is_refused_with_what_was_found():
    rate = 8000
    noise = 0.01 * np.random.default_rng(1).normal(size=4 * rate)
    knock, bad = noise.copy(), noise.copy()
    knock[rate : rate + 80] += np.sin(np.arange(80)) * np.exp(-np.arange(80) / 20)
    bad[100] = np.nan
    for samples, words in (
        (np.zeros(60 * rate), "60 s of sound .* without a sound above the background"),
        (noise, "no bounce was found"),
        (knock, r"with 1 sound above .* \(at 1\.0.* s\), but no series of at least 4"),
        (noise[:800], "is 0.1 s long, too short for bounces; record a ball"),
        (np.zeros(0), "is 0 s long, too short"),
    ):
        refused(words, file_of(samples, rate))
    refused("holds samples that are not finite", file_of(bad, rate, "FLOAT"))
    refused("has 2000 samples per second, but at least 4000", file_of(noise, 2000))
    refused(r"is MPEG-4 \(m4a\), .*ffmpeg", io.BytesIO(b"\0\0\0 ftypM4A " + bytes(100)))
    whole = file_of(noise, rate).getvalue()
    without_channels = whole[:22] + b"\0\0" + whole[24:]
    for content in (b"RIFF\x10\0\0\0WAVEfmt ", whole[:36], without_channels):
        refused("is a WAV file that cannot be read", io.BytesIO(content))
    for words, how in (
        ("`layout` must be None or 'intervals' for a sound", {"layout": "heights"}),
        ("`ball` must be None for a sound", {"ball": "blue"}),
        ("`columns or decimal` must be None", {"columns": "speed=1,e=2"}),
    ):
        with pytest.raises(ValueError, match=f"Argument {words}"):
            jc.read_recording(io.BytesIO(as_wave(truth())), **how)
    with pytest.raises(jc.RecordingError, match="is a sound, which has no such columns"):
        read_columns(io.BytesIO(as_wave(truth())), ["time", "force"], needed=["time"])
    # Words that begin like a sound are a table.
    for text in ("ID3;interval\n1;0.4\n2;0.3\n", "FORMAT,interval\na,0.4\nb,0.3\n"):
        assert len(jc.read_recording(io.BytesIO(text.encode()))) == 2


def test_a_long_recording_is_read_in_blocks(tmp_path):
    """Of two minutes no more than a few blocks are held: a block is 16 times shorter here."""
    import tracemalloc

    rate = 44100
    whole = np.zeros(120 * rate, np.int16)
    samples = np.round(truth().samples * 32767).astype(np.int16)
    whole[50 * rate : 50 * rate + samples.size] = samples
    path = tmp_path / "long.wav"
    soundfile.write(path, whole, rate)
    tracemalloc.start()
    sound = listen(path)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(sound.drops) == 1
    assert most < 60e6  # the file as floating-point numbers has 42 MB; measured 30 MB


def test_small_study():
    """A small form of benchmarks/lab/sound.py; speech is no ball."""
    # The first number of a draw is its rate; fewer samples take less time.
    slow = [k for k in range(150) if np.random.default_rng([7, k]).choice(RATES) <= 16000]
    found = summary([one_of(np.random.default_rng([7, k])) for k in slow[:60]])
    assert found["none invented"] >= 0.93 and found["found"] >= 0.9
    assert found["fitted"] >= 35
    # The probability of fewer than 85 % at 95 % coverage is below 1 % for 40.
    assert found["in interval"] >= 0.85
    rows = [one_of(np.random.default_rng([8, k]), bounces=False, speech=True) for k in range(8)]
    assert summary(rows)["none invented"] == 1


def test_scatter_beside_known_errors_is_found():
    random = np.random.default_rng(0)
    n = 400
    known = np.diag(random.uniform(0.5, 2, n) ** 2) * 1e-6
    columns = np.ones((n, 1))
    draws = np.linalg.cholesky(known + 4e-6 * np.eye(n)) @ random.normal(size=n)
    assert abs(scatter_beside(draws, columns, known) / 2e-3 - 1) < 0.15
    alone = np.linalg.cholesky(known) @ random.normal(size=n)
    assert scatter_beside(alone, columns, known) < 4e-4


def test_the_covariance_of_pairs_is_that_of_their_times():
    """By the slopes of ln e by each time, and by the duration of contact, in vacuum."""
    recording = jc.read_recording(interval_s=FLIGHTS)
    sigma, contact = np.array([1e-5, 3e-5, 2e-5, 5e-5, 4e-5]), 1e-4
    records = tuple(
        dataclasses.replace(one, timing=Timing(*sigma[k : k + 2], contact))
        for k, one in enumerate(recording.records)
    )
    got = make_pairs(dataclasses.replace(recording, records=records), Flight()).covariance
    share = (FLIGHTS / FLIGHTS[0]) ** -0.2
    slopes = np.zeros((3, 6))
    for k, (one, other) in enumerate(itertools.pairwise(FLIGHTS)):
        slopes[k, k : k + 3] = 1 / one, -1 / one - 1 / other, 1 / other
        slopes[k, 5] = share[k + 1] / other - share[k] / one
    wanted = slopes @ np.diag([*sigma, contact]) ** 2 @ slopes.T
    np.testing.assert_allclose(got, wanted, rtol=1e-10, atol=1e-12 * wanted.max())


def test_the_picture_has_marks():
    ax = jc.plot.sound(recorded())
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert "bounce, used" in labels
    assert ax.get_xlabel() == "time $t$ / s"
    ax.figure.clear()
    with pytest.raises(ValueError, match="must be that of a sound file"):
        jc.plot.sound(jc.read_recording())


def test_samples_in_a_column_are_heard_as_those_of_a_file():
    rate = truth().rate
    head = (2.5 + 40 * truth().samples)[: int(2 * rate)]  # in any unit, over any level
    by_rate = jc.read_recording({"Sound Pressure (a.u.)": head}, rate=rate)
    assert by_rate.layout.name == "sound" and by_rate.sound is not None
    found = times(by_rate)
    some = heard()[heard() < 2 - 0.1]
    assert len(some) >= 4
    np.testing.assert_allclose(found[: len(some)], some, atol=2e-6)
    assert any("samples" in note or "bounces" in note for note in by_rate.notes)
    timed = {"t (ms)": np.round(1e3 * np.arange(head.size) / rate, 4), "amplitude": head}
    np.testing.assert_allclose(times(jc.read_recording(timed)), found, atol=1e-6)
    refused("is the same everywhere", {"sound": np.ones(20_000)}, rate=rate)
    refused("is missing; beside amplitude a column time", {"amplitude": head})

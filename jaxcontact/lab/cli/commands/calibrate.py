"""`jaxcontact calibrate`: laws from a recording of bounces."""

from __future__ import annotations

import argparse
import csv
import dataclasses
import io
import os
import pathlib
from typing import Any

from ....extend import Stages, progress_of, wrapped
from ..law import AIR, GRAVITY, IN_AIR, TABLE, drag_asked, drag_notes
from ..options import (
    READ,
    InputError,
    Output,
    input_errors,
    naming,
    output_folder,
    output_path,
    refuse,
    table_asked,
    written,
)

FIGURE = "calibration.png"
NUMBERS = "calibration.json"
CSV = "calibration.csv"
SOUND = "sound.png"
RECORD = "record.png"
TRACK = "track.png"
REPORT = "calibration.md"

ALL = "all"

SUMMARY = "fit laws to a recording of bounces or to oblique impacts"

DESCRIPTION = """\
Fit laws to a recording of bounces. The command converts it to pairs (closing speed, e), and
finds spurious and missed triggers by a robust rule. It compares a constant e with speed-dependent
laws: constant damping, damping as a power of the speed, Kuwabara-Kono, elastic-plastic spheres
without and with damping, wet and adhesive bodies, 1 - b v^p. It writes calibration.png and
calibration.json. The default FILE is the shipped one: bounce intervals of a small rubber ball. For
a table of oblique impacts it fits friction laws instead, and writes calibration.json.
"""

EPILOG = """\
The output is e with its 95 % interval at the slowest and the fastest measured speed (and at --at),
the law, the data, and the next measurement. The interval is for the mean e at a speed, given the
law. --details prints all tables. For one to three pairs the output is the e of each and their
mean; a law needs four.

FILE is a table: text (CSV and its relatives, decimal commas too), a spreadsheet or parquet. It has
one of these sets of columns, with headings by any usual name ("v", "COR", "speed (mm/s)"):
  interval_s [ball, drop_height_m, trial, bounce, sigma]
                                                       seconds between successive impacts, or laps
                                                       of a stopwatch; `bounce` counts the
                                                       intervals of a trial
  bounce_time_s [ball, drop_height_m, trial, bounce, label]
                                                       instants of bounces: split times of a
                                                       stopwatch, labels of an audio editor
  drop_height_m, rest_time_s [ball, trial]             a drop and the time until the ball rests
  drop_height_m, rebound_height_m [ball, trial]        a drop and the height of its first rebound
  velocity, restitution [ball, sigma]                  closing speed in m/s and e
  velocity, rebound_velocity [ball]                    speeds in m/s before and after an impact
  height_m [ball, trial, bounce]                       heights of successive flights
  y, time | frame [x, ball | particle, trial]          positions of a ball in a video (track), in m,
                                                       pixels or any unit, counted up or down
  time, force | acceleration | indentation             readings of an instrument over time, with one
                                                       or several impacts
  time, sound                                          samples of a sound
  angle, speed | normal_velocity, tangential_velocity; and tangential_restitution |
  tangential_rebound | rebound_angle | rebound_spin [e, ball]
                                                       oblique impacts: the angle from the normal
                                                       (deg or rad) and the speed, or both speeds
                                                       in m/s; after them v_t'/v_t, v_t', the angle
                                                       or the spin, in several columns or one
Columns in brackets are optional; other columns are ignored. A unit in a heading is converted, and
the report notes it. `sigma` holds standard deviations of e or of the intervals. Columns of other
standard deviations are listed as not used. Rows in messages are lines of the file; the header is
row 1.

FILE may also be a sound: WAV, and FLAC, OGG and MP3 with `pip install 'jaxcontact[sound]'`. In a
track from video parabolas are fitted between the impacts; without times, --rate gives the frames
per second. Impacts in a record of an instrument (unit of accelerations written: m/s² or g) need
--mass; --rate replaces a column of time, and --exponent is the n of the force, 3/2 by default.
sound.png, track.png and record.png show what was found and fitted.

e from two intervals of a trial with successive bounces: e = T2/T1 at closing speed g T1/2, or with
drag by its flight times; from heights: e = sqrt(h1/h0) at sqrt(2 g h0), or with drag. A pair far
from every law that describes the rest, or else from their trend, is marked and left out; the result
with it is shown as well.

Oblique impacts need e, from a column or --restitution, and for spins --radius. --tangential-ratio,
2(1-ν)/(2-ν) for like materials, holds κ of Maw-Barber-Fawcett, which is fitted otherwise.

Sheets of a spreadsheet with equal headings are trials, and so are equal columns side by side.
--sheet chooses among others.

--law NAME: `constant_damping`, `power_damping`, `kuwabara_kono`, `thornton_plastic`,
`viscoplastic`, `wet_restitution`, `jkr`, `power_restitution`, `bridges`, `linear_dashpot` or
`step_damping` is compared with a constant e; a law with parameter e (see `jaxcontact laws`)
delivers the constant e and is compared with all but the last three of them; few recordings
distinguish these from the others. --law all, the default, does this for the exact constant e. Every
law with parameter e delivers a constant e; the report lists the e to set in each.

e(v) alone determines only c/K of constant damping and only A (K/m)^(2/5) of Kuwabara-Kono.
--stiffness determines c; --mass and --stiffness determine A.

--ball all fits one --law to each ball of a table. The output is one row for each: the parameters
with standard errors, e at the speeds --at (by default at the median speed), and the status. They
are those of `--ball NAME`. The file calibration.csv holds all rows; no other file is written.

`jaxcontact.load_calibration("calibration.json").law` is the fitted law.

exit codes: 0 done; 1 a fit did not converge (everything is written); 2 bad input, nothing written.
"""

OPTIONS = f"""
[FILE] | | recording (default: the shipped one)
--law NAME | = {ALL} | law to fit (default: all of nine kinds)
--ball NAME | | ball to use if the file holds several (default for the shipped file: blue); {ALL}
    fits one --law to each, and writes {CSV}
{TABLE}
--out DIR | = . | folder for {FIGURE} and {NUMBERS}, made if missing (default: the current
    one)
{GRAVITY}
--stiffness K | positive | Hertz stiffness in N/m^(3/2); determines c, and with --mass also A
--rate HZ | positive | readings of a record, or frames of a video, per second
--exponent N | positive | exponent n of the force of a record (default: 1.5)
--restitution E | positive | e of oblique impacts, without a column of it
--tangential-ratio KAPPA | positive | tangential over normal stiffness, for oblique impacts
--report [FILE] | | also write a report: .html, one page with pictures and settings for
    simulators, .md, .txt or .json; without FILE {REPORT} beside the figure
--at V ... | positive | also print e at this closing speed in m/s; may be repeated
--details | flag | print everything: marked pairs, parameters of all laws, their comparison
{IN_AIR}
--mass KG | positive | mass of the ball in kg (also used for A, and for records)
{AIR}"""


def run(arguments: argparse.Namespace, progress: Stages) -> Output:
    """Calibrate a ball, every ball of a table, or the friction of oblique impacts."""
    progress("reading the recording")
    from ...calibration.calibrate_friction import is_oblique

    if arguments.file is not None and is_oblique(arguments.file, **table_asked(arguments)):
        return _friction(arguments, progress)
    table = "a table with an angle or a tangential velocity, and an outcome"
    refuse(arguments, _OWN, f"is for oblique impacts only: {table}")
    if arguments.ball == ALL:
        return _every_ball(arguments, progress)
    return _one_ball(arguments, progress)


def _one_ball(arguments: argparse.Namespace, progress: Stages) -> Output:
    """Return the laws of one ball, with pictures and a report."""
    from .... import plot
    from ....extend import STANDARD_GRAVITY, render
    from ...calibration.calibrate import calibrate
    from ...recordings import read_recording

    page = _page(arguments.report, pathlib.Path(arguments.out))
    out = output_folder(arguments.out)
    with input_errors(_named):
        how = {"ball": arguments.ball, "rate": arguments.rate} | table_asked(arguments)
        recording = read_recording(arguments.file, **how)
    drag = None if recording.layout.fitted else drag_asked(arguments)
    if recording.layout.uses_flight:
        notes = (*drag_notes(arguments), *recording.notes)
        recording = dataclasses.replace(recording, notes=notes)
    with input_errors(_named):
        result = calibrate(
            recording,
            laws=arguments.law,
            drag=drag,
            mass=arguments.mass,
            stiffness=arguments.stiffness,
            exponent=arguments.exponent,
            gravity=arguments.gravity or STANDARD_GRAVITY,
            at=arguments.at,
            progress=progress,
        )
    progress("drawing and writing")

    def picture(name: str, draw: Any, of: Any, size: tuple[float, float], axes: int = 1) -> None:
        files[out / name] = render(lambda f: draw(of, ax=f.subplots(axes)), size, out / name)

    files: dict[pathlib.Path, bytes] = {}
    picture(FIGURE, plot.calibration, result, (7.0, 4.6))
    files[out / NUMBERS] = result.to_json().encode()
    if recording.sound is not None:
        picture(SOUND, plot.sound, recording, (8.0, 4.0))
    if recording.tracks:
        picture(TRACK, plot.track, recording, (8.0, 4.0))
    if result.impacts:
        picture(RECORD, plot.record, result, (8.0, 7.0), axes=2)
    if page is not None:
        from ...report_page import content_of

        link = pathlib.Path(os.path.relpath(out / FIGURE, page.parent)).as_posix()
        files[page] = content_of(result, page, arguments.radius, progress, link, arguments.line)
    shown = result.report() if arguments.details else result
    numbers = files[out / NUMBERS].decode()
    return Output([shown, written(files)], numbers, files, 0 if result.converged else 1)


def _named(text: str) -> str:
    """Return an error with options in place of arguments."""
    text = naming(f"{READ} mass stiffness exponent", laws="law")(text)
    each = f", or fit one --law to each with --ball {ALL}" if "choose one with" in text else ""
    return text + each


def _page(name: str | None, out: pathlib.Path) -> pathlib.Path | None:
    """Return the file of `--report`, None without it; raise InputError for another extension."""
    if not name:
        return None if name is None else out / REPORT
    from ...report_page import PDF, SUFFIXES

    path = pathlib.Path(name)
    if path.suffix.lower() == ".pdf":
        raise InputError(f"--report {name}: {PDF.format(path.stem)}")
    if path.suffix.lower() not in SUFFIXES and path.exists():
        raise InputError(
            f"--report {name}: is this the recording? Then put it first: "
            f"`jaxcontact calibrate {name} --report`"
        )
    return output_path("--report", name, SUFFIXES)


def _every_ball(arguments: argparse.Namespace, progress: Stages) -> Output:
    """Return one law of each ball, a row for each."""
    from .... import FitStatus
    from ....extend import STANDARD_GRAVITY, Flight
    from ...calibration.every_ball import calibrate_each, row_of, text_of
    from ...recordings import read_recordings

    drag = drag_asked(arguments)
    refuse(arguments, ("report", "exponent"), f"is for one ball, but --ball is {ALL}")
    if arguments.law == "all":
        raise InputError(
            f"--ball {ALL} fits one law to each ball: choose it, as in --law constant_damping or, "
            "for a constant e, --law exact"
        )
    file = output_folder(arguments.out) / CSV
    if arguments.file is not None and file.exists() and file.samefile(arguments.file):
        raise InputError(f"--out {file.parent}: {CSV} there is the file that is read")
    with input_errors(naming(READ)):
        how = table_asked(arguments) | {"rate": arguments.rate}
        recordings = read_recordings(arguments.file, **how)
    first = next(iter(recordings.values()))
    notes = [one for one in first.notes if all(one in ball.notes for ball in recordings.values())]
    notes = [*drag_notes(arguments), *notes] if first.layout.uses_flight else notes
    if ALL in recordings:
        raise InputError(f"{first.source}: a ball is called {ALL!r}; rename it for --ball {ALL}")
    if first.layout.fitted:
        raise InputError(f"--ball {ALL}: {first.source} is a record of one ball")
    progress(f"compiling, and fitting {len(recordings):,} balls")
    with (
        input_errors(naming("", laws="law")),
        progress_of(False if arguments.quiet else None, "balls", "calibrate") as tell,
    ):
        fits = calibrate_each(
            recordings,
            arguments.law,
            flight=Flight(arguments.gravity or STANDARD_GRAVITY, drag),
            mass=arguments.mass,
            stiffness=arguments.stiffness,
            at=arguments.at,
            tell=tell,
        )
    rows = [row_of(one) for one in fits]
    header = max(rows, key=len)
    text = io.StringIO()
    writer = csv.DictWriter(text, header, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    files = {file: text.getvalue().encode()}
    read_as = wrapped("Read as", "; ".join(notes))
    title = f"{arguments.law} for each ball of {first.source}"
    shown = [title, text_of(fits, whole=arguments.details), *read_as, written(files)]
    balls = [{name: row.get(name) for name in header} for row in rows]
    data = {"source": first.source, "law": arguments.law, "read_as": notes, "balls": balls}
    poor = any(one.status == FitStatus.NOT_CONVERGED for one in fits)
    return Output(shown, data, files, 1 if poor else 0)


_OWN = "restitution", "tangential_ratio"
_BOUNCES = (
    *("law", "mass", "stiffness", "rate", "exponent", "report", "at", "gravity"),
    *("drag_coefficient", "air_density"),
)
"""Options of oblique impacts, and of the others alone."""


def _friction(arguments: argparse.Namespace, progress: Stages) -> Output:
    """Return the friction laws of oblique impacts."""
    from ...calibration.calibrate_friction import calibrate_friction

    refuse(arguments, _BOUNCES, "does not apply to oblique impacts")
    file = output_folder(arguments.out) / NUMBERS
    with input_errors(naming(f"{READ} radius {' '.join(_OWN)}")):
        result = calibrate_friction(
            arguments.file,
            restitution=arguments.restitution,
            tangential_ratio=arguments.tangential_ratio,
            radius=arguments.radius,
            ball=arguments.ball,
            progress=progress,
            **table_asked(arguments),
        )
    numbers = result.to_json()
    files = {file: numbers.encode()}
    return Output([result, written(files)], numbers, files, 0 if result.converged else 1)

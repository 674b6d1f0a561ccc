"""`jaxcontact calibrate`: laws from a recording of bounces."""

from __future__ import annotations

import argparse
import csv
import dataclasses
import io
import os
import pathlib
import re
from typing import TYPE_CHECKING

from ....extend import Stages, progress_of, wrapped, write_all
from ..options import (
    InputError,
    add_air_options,
    add_table_options,
    drag_asked,
    drag_notes,
    gravity_asked,
    in_options,
    input_errors,
    output_path,
    positive,
    print_json,
    table_asked,
)

if TYPE_CHECKING:
    from .... import Drag

FIGURE = "calibration.png"
NUMBERS = "calibration.json"
TABLE = "calibration.csv"
SOUND = "sound.png"
RECORD = "record.png"
TRACK = "track.png"
REPORT = "calibration.md"

ALL = "all"

SUMMARY = "fit laws to a recording of bounces or to oblique impacts"

DESCRIPTION = """\
Fit laws to a recording of bounces. The command converts it to pairs (approach speed, e), and
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
  velocity, restitution [ball, sigma]                  approach speed in m/s and e
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

e from two intervals of a trial with successive bounces: e = T2/T1 at approach speed g T1/2, or with
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


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "file", nargs="?", metavar="FILE", help="recording (default: the shipped one)"
    )
    parser.add_argument(
        "--law",
        metavar="NAME",
        default="all",
        help="law to fit (default: all of nine kinds)",
    )
    parser.add_argument(
        "--ball",
        metavar="NAME",
        help="ball to use if the file holds several (default for the shipped file: blue); "
        f"{ALL} fits one --law to each, and writes {TABLE}",
    )
    add_table_options(parser)
    parser.add_argument(
        "--out",
        metavar="DIR",
        default=".",
        help=f"folder for {FIGURE} and {NUMBERS}, made if missing (default: the current one)",
    )
    add_air_options(parser, mass="mass of the ball in kg (also used for A, and for records)")
    follow = "Hertz stiffness in N/m^(3/2); determines c, and with --mass also A"
    for name, metavar, words in (
        ("--stiffness", "K", follow),
        ("--rate", "HZ", "readings of a record, or frames of a video, per second"),
        ("--exponent", "N", "exponent n of the force of a record (default: 1.5)"),
        ("--restitution", "E", "e of oblique impacts, without a column of it"),
        ("--tangential-ratio", "KAPPA", "tangential over normal stiffness, for oblique impacts"),
    ):
        parser.add_argument(name, metavar=metavar, type=positive, help=words)
    parser.add_argument(
        "--report",
        metavar="FILE",
        nargs="?",
        const="",
        help="also write a report: .html, one page with pictures and settings for simulators, "
        f".md, .txt or .json; without FILE {REPORT} beside the figure",
    )
    parser.add_argument(
        "--at",
        metavar="V",
        type=positive,
        action="append",
        default=[],
        help="also print e at this approach speed in m/s; may be repeated",
    )
    parser.add_argument(
        "--details",
        action="store_true",
        help="print everything: marked pairs, parameters of all laws, their comparison",
    )


def run(arguments: argparse.Namespace, progress: Stages) -> int:
    """Calibrate; return 0, or 1 if a fit did not converge. Raises InputError, OSError."""
    progress("reading the recording")
    if is_friction(arguments):
        return run_friction(arguments, progress)
    if arguments.ball == ALL:
        return run_every_ball(arguments, drag_asked(arguments), progress)
    from ....extend import render
    from ....plot import calibration, record, sound, track
    from ...calibration.calibrate import calibrate
    from ...recordings import RecordingError, read_recording

    out = pathlib.Path(arguments.out)
    page = _page(arguments.report, out)
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out} is not a folder")
    with input_errors(_in_options):
        how = {"ball": arguments.ball, "rate": arguments.rate} | table_asked(arguments)
        recording = read_recording(arguments.file, **how)
    drag = None if recording.layout.fitted else drag_asked(arguments)
    if recording.layout.uses_flight:
        notes = (*drag_notes(arguments), *recording.notes)
        recording = dataclasses.replace(recording, notes=notes)
    try:
        result = calibrate(
            recording,
            laws=arguments.law,
            drag=drag,
            mass=arguments.mass,
            stiffness=arguments.stiffness,
            exponent=arguments.exponent,
            gravity=gravity_asked(arguments),
            at=arguments.at,
            progress=progress,
        )
    except RecordingError as error:
        raise InputError(in_options(str(error))) from error
    except ValueError as error:
        # The parser has checked the numbers. The remaining errors are a law that cannot be fitted
        # to e(v), and missing numbers of a record.
        option = re.match(r"Argument `(mass|stiffness|exponent|law)s?`", str(error))
        if option:
            raise InputError(str(error).replace(option[0], f"--{option[1]}", 1)) from error
        raise InputError(f"--law: {error}") from error
    progress("drawing and writing")
    figure = render(lambda f: calibration(result, ax=f.add_subplot()), (7.0, 4.6), out / FIGURE)
    files = {out / FIGURE: figure, out / NUMBERS: result.to_json().encode()}
    if recording.sound is not None:
        picture = render(lambda f: sound(recording, ax=f.add_subplot()), (8.0, 4.0), out / SOUND)
        files[out / SOUND] = picture
    if recording.tracks:
        picture = render(lambda f: track(recording, ax=f.add_subplot()), (8.0, 4.0), out / TRACK)
        files[out / TRACK] = picture
    if result.impacts:
        picture = render(lambda f: record(result, ax=f.subplots(2)), (8.0, 7.0), out / RECORD)
        files[out / RECORD] = picture
    if page is not None:
        from ...report_page import content_of

        picture = pathlib.Path(os.path.relpath(out / FIGURE, page.parent)).as_posix()
        files[page] = content_of(result, page, arguments.radius, progress, picture)
    write_all(files)
    if arguments.json:
        print(files[out / NUMBERS].decode(), end="")
    else:
        print(result.report() if arguments.details else result)
        print("\n".join(wrapped("Written", ", ".join(map(str, files)))))
    return 0 if result.converged else 1


def _in_options(text: str) -> str:
    """Return the error of a reader, with options in place of arguments."""
    text = in_options(text)
    return (
        f"{text}, or fit one --law to each with --ball {ALL}" if "choose one with" in text else text
    )


def _page(name: str | None, out: pathlib.Path) -> pathlib.Path | None:
    """Return the file of `--report`, None without it; raise InputError for another extension."""
    if name is None:
        return None
    if not name:
        return out / REPORT
    from ...report_page import PDF, SUFFIXES

    if pathlib.Path(name).suffix.lower() == ".pdf":
        raise InputError(f"--report {name}: {PDF.format(pathlib.Path(name).stem)}")
    if pathlib.Path(name).suffix.lower() not in SUFFIXES and pathlib.Path(name).exists():
        raise InputError(
            f"--report {name}: is this the recording? Then put it first: "
            f"`jaxcontact calibrate {name} --report`"
        )
    return output_path("--report", name, SUFFIXES)


_OF_ONE = "report", "exponent"
"""Options of the calibration of one ball."""


def run_every_ball(arguments: argparse.Namespace, drag: Drag | None, progress: Stages) -> int:
    """Fit one law to each ball; return 0, or 1 if a fit did not converge.

    Raises InputError, OSError.
    """
    from .... import FitStatus
    from ....extend import Flight
    from ...calibration.every_ball import calibrate_each, row_of, text_of
    from ...recordings import read_recordings

    for name in _OF_ONE:
        if getattr(arguments, name) is not None:
            raise InputError(f"--{name} is for one ball, but --ball is {ALL}")
    if arguments.law == "all":
        raise InputError(
            f"--ball {ALL} fits one law to each ball: choose it, as in --law constant_damping or, "
            "for a constant e, --law exact"
        )
    out = pathlib.Path(arguments.out)
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out} is not a folder")
    file = out / TABLE
    if arguments.file is not None and file.exists() and file.samefile(arguments.file):
        raise InputError(f"--out {out}: {TABLE} there is the file that is read")
    how = table_asked(arguments) | {"rate": arguments.rate}
    with input_errors(in_options):
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
        input_errors(lambda text: text.replace("Argument `laws`", "--law")),
        progress_of(False if arguments.quiet else None, "balls", "calibrate") as tell,
    ):
        fits = calibrate_each(
            recordings,
            arguments.law,
            flight=Flight(gravity_asked(arguments), drag),
            mass=arguments.mass,
            stiffness=arguments.stiffness,
            at=arguments.at,
            tell=tell,
        )
    rows = [row_of(one) for one in fits]
    header = max(rows, key=len)
    rows = [{name: row.get(name) for name in header} for row in rows]
    text = io.StringIO()
    writer = csv.DictWriter(text, header, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_all({file: text.getvalue().encode()})
    if arguments.json:
        whole = {"source": first.source, "law": arguments.law, "read_as": notes}
        print_json({**whole, "balls": rows})
    else:
        print(f"{arguments.law} for each ball of {first.source}")
        print(text_of(fits, whole=arguments.details))
        if notes:
            print("\n".join(wrapped("Read as", "; ".join(notes))))
        print("\n".join(wrapped("Written", str(file))))
    return 1 if any(one.status == FitStatus.NOT_CONVERGED for one in fits) else 0


_OWN = "restitution", "tangential_ratio"
_BOUNCES = (
    *("law", "mass", "stiffness", "rate", "exponent", "report", "at", "gravity"),
    *("drag_coefficient", "air_density"),
)
"""Options that do not apply to oblique impacts."""


def is_friction(arguments: argparse.Namespace) -> bool:
    """Return whether the file holds oblique impacts; InputError for their options beside others."""
    from ...calibration.calibrate_friction import is_oblique

    if arguments.file is not None and is_oblique(arguments.file, **table_asked(arguments)):
        return True
    for name in _OWN:
        if getattr(arguments, name) is not None:
            raise InputError(
                f"--{name.replace('_', '-')} is for oblique impacts only: a table with an angle or "
                "a tangential velocity, and an outcome"
            )
    return False


def run_friction(arguments: argparse.Namespace, progress: Stages) -> int:
    """Fit friction laws; return 0, or 1 if a fit did not converge. Raises InputError, OSError."""
    from ...calibration.calibrate_friction import calibrate_friction

    for name in _BOUNCES:
        if getattr(arguments, name) not in (None, "all", []):
            raise InputError(f"--{name.replace('_', '-')} does not apply to oblique impacts")
    out = pathlib.Path(arguments.out)
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out} is not a folder")
    with input_errors(_oblique_in_options):
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
    write_all({out / NUMBERS: numbers.encode()})
    if arguments.json:
        print(numbers, end="")
    else:
        print(result)
        print("\n".join(wrapped("Written", str(out / NUMBERS))))
    return 0 if result.converged else 1


def _oblique_in_options(text: str) -> str:
    """Return an error with options in place of arguments."""
    for name in (*_OWN, "radius"):
        text = text.replace(f"Argument `{name}`", f"--{name.replace('_', '-')}")
    return in_options(text)

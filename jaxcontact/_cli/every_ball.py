"""`jaxcontact calibrate --ball all`: one law for each ball of a file."""

from __future__ import annotations

import argparse
import csv
import io
import pathlib
from typing import TYPE_CHECKING

from .._text.files import write_all
from .._text.progress import Stages, progress_of
from .._text.table import wrapped
from .air import drag_notes, gravity_asked
from .options import InputError, input_errors
from .printing import print_json
from .table import in_options, table_asked

if TYPE_CHECKING:
    from .._flight import Drag

ALL = "all"
TABLE = "calibration.csv"

_OF_ONE = "report", "exponent"
"""Options of the calibration of one ball."""


def run_every_ball(arguments: argparse.Namespace, drag: Drag | None, progress: Stages) -> int:
    """Fit one law to each ball; return 0, or 1 if a fit did not converge.

    Raises InputError, OSError.
    """
    from .._fit import FitStatus
    from .._flight import Flight
    from .._lab.calibration.every_ball import calibrate_each, row_of, text_of
    from .._lab.recordings import read_recordings

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

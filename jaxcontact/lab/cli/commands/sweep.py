"""`jaxcontact sweep`: a table of impacts over ranges of parameters, and a map."""

from __future__ import annotations

import argparse
import functools
import importlib.util
import math
import pathlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, BinaryIO

from ....extend import FIGURES, Stages, write_all
from ..law import add_law_and_contact, exponent_asked, law_parameters
from ..options import InputError, output_path, print_json, span

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .... import Impact, Sweep

SUMMARY = "impacts over ranges of parameters, as a table and a map"

DESCRIPTION = """\
Solve impacts over the grid of one or more ranges. Numbers may be ranges FROM:TO:COUNT, with evenly
spaced values, or FROM:TO:COUNT:log, spaced by a factor. Write all fields of the impacts, and draw
one of them: lines over one range, a map over two.
"""

EPILOG = """\
example: jaxcontact sweep --law hu_guo --e 0.05:1:96 --velocity 0.01:10:200:log --out result.nc

A .nc file is NetCDF (version 3), with units; it needs `pip install 'jaxcontact[data]'`. A .csv file
has one row for each impact. A parameter that leaves its range flags its impacts as INVALID_INPUT.

exit codes: 0 done; 1 some impacts could not be solved to accuracy, or have numbers too large for
double precision (everything is written), or the sweep was interrupted; 2 bad input, nothing
written.
"""

_CONTACT = {"mass": 1.0, "stiffness": 1e8, "velocity": 1.0}
"""Defaults; the restitution often depends on none of them."""


def add_options(parser: argparse.ArgumentParser) -> None:
    form = "RANGE", "c=1e5:1e7:50:log"
    add_law_and_contact(parser, number=span, size=span, form=form, defaults=_CONTACT)
    parser.add_argument(
        "--out", metavar="FILE", required=True, help="the table to write; .nc or .csv"
    )
    words = "draw a field, 6.4 in by 4.4 in; .png, .pdf or .svg"
    parser.add_argument("--plot", metavar="FILE", help=words)
    parser.add_argument(
        "--field", metavar="NAME", default="restitution", help="to draw (default: restitution)"
    )


def run(arguments: argparse.Namespace, progress: Stages) -> int:
    """Sweep over the given ranges and write the table. Raises InputError, OSError."""
    import numpy as np

    out = output_path("--out", arguments.out, (".nc", ".csv"))
    if out.suffix.lower() == ".nc" and importlib.util.find_spec("xarray") is None:
        raise InputError(
            f"--out {out}: NetCDF needs xarray (pip install 'jaxcontact[data]'); .csv does not"
        )
    parameters: dict[str, Any] = law_parameters(arguments) | {
        name: default if getattr(arguments, name) is None else getattr(arguments, name)
        for name, default in _CONTACT.items()
    }
    plot = _plot(arguments, parameters)
    function = _function(arguments, parameters)
    from .... import Status, sweep

    lanes = math.prod(np.size(values) for values in parameters.values())
    progress(f"compiling and solving {lanes:,} impacts")
    table = sweep(function, progress=False if arguments.quiet else None, **parameters)
    progress("writing")
    contents: dict[pathlib.Path, bytes | Callable[[BinaryIO], object]] = {}
    if out.suffix.lower() == ".nc":
        contents[out] = bytes(table.to_xarray().to_netcdf(engine="scipy"))
    else:
        contents[out] = table.to_csv
    if plot is not None:
        from ....extend import render
        from ....plot import sweep as draw

        def fill(figure: Figure) -> None:
            draw(table, field=arguments.field, ax=figure.subplots())

        contents[plot] = render(fill, (6.4, 4.4), plot)
    write_all(contents)
    beyond = _beyond(table)
    if arguments.json:
        print_json(
            {
                "axes": table.axes,
                "fields": list(table.fields),
                "status": {Status(code).name: n for code, n in table.status_counts().items()},
                "beyond": beyond,
                "complete": table.complete,
                "files": list(map(str, contents)),
            }
        )
    else:
        print(table)
    if beyond and not arguments.json:
        print(f"  beyond  {beyond:,} separated impacts have numbers too large for double precision")
    failed = Status.NOT_CONVERGED in table.status_counts()
    return 1 if failed or beyond or not table.complete else 0


def _beyond(table: Sweep) -> int:
    """Return how many separated contacts have a non-finite field."""
    import numpy as np

    from .... import Status
    from ....extend import NUMBERS

    fields = (name for name in NUMBERS if name in table.fields)
    lost = functools.reduce(np.logical_or, (~np.isfinite(table[name]) for name in fields))
    return int(np.count_nonzero(lost & (table.status == Status.SEPARATED)))


def _plot(arguments: argparse.Namespace, parameters: dict[str, Any]) -> pathlib.Path | None:
    import numpy as np

    from ....extend import NUMBERS, did_you_mean

    if arguments.plot is None:
        return None
    plot = output_path("--plot", arguments.plot, FIGURES)
    if arguments.field not in NUMBERS:
        raise InputError(
            f"--field: {arguments.field!r} is not one of {', '.join(NUMBERS)}."
            f"{did_you_mean(arguments.field, NUMBERS)}"
        )
    ranges = sum(isinstance(values, np.ndarray) for values in parameters.values())
    if ranges not in (1, 2):
        raise InputError(f"--plot {plot}: takes one or two ranges, but there are {ranges}")
    return plot


def _function(arguments: argparse.Namespace, parameters: dict[str, Any]) -> Callable[..., Impact]:
    """Return a function of one impact; raise InputError if a single number is out of range."""
    from .... import Contact, get_law, impact
    from ....extend import POSITIVE, SPEED, parameters_of

    names = [name for name in parameters if name not in _CONTACT]
    exponent = exponent_asked(arguments)

    def impact_of(**numbers: Any) -> Impact:
        law = get_law(arguments.law, **{name: numbers[name] for name in names})
        contact = Contact(numbers["mass"], numbers["stiffness"], exponent)
        return impact(law, contact, numbers["velocity"])

    impact_of.__name__ = arguments.law
    allowed = {
        **parameters_of(arguments.law),
        **dict.fromkeys(("mass", "stiffness"), POSITIVE),
        "velocity": SPEED,
    }
    for name, value in parameters.items():
        if isinstance(value, float) and not allowed[name].holds(value):
            raise InputError(f"{name} must be in {allowed[name]}, but is {value:g}")
    return impact_of

"""`jaxcontact sweep`: a table of impacts over ranges of parameters, and a map."""

from __future__ import annotations

import argparse
import functools
import importlib.util
import math
import pathlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ....extend import FIGURES, Stages
from ..law import exponent_asked, law_parameters
from ..options import InputError, Output, output_path

if TYPE_CHECKING:
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

OPTIONS = """
--law NAME | required | name of the law; see `jaxcontact laws`
--e E | range | parameter e of the law
--param NAME=RANGE ... | range | another parameter of the law, in SI units (such as
    c=1e5:1e7:50:log); may be repeated
--mass KG | range, = 1 | effective mass in kg (default: 1)
--stiffness K | range, = 1e8 | K of K δⁿ, in N/mⁿ (default: 1e+08)
--velocity V | range, = 1 | closing speed in m/s (default: 1)
--exponent N | positive | n of K δⁿ (default: the law's own, or 1.5)
--out FILE | required | the table to write; .nc or .csv
--plot FILE | | draw a field, 6.4 in by 4.4 in; .png, .pdf or .svg
--field NAME | = restitution | to draw (default: restitution)
"""


def run(arguments: argparse.Namespace, progress: Stages) -> Output:
    """Sweep over the given ranges, and return the table and its files."""
    import numpy as np

    out = output_path("--out", arguments.out, (".nc", ".csv"))
    netcdf = out.suffix.lower() == ".nc"
    if netcdf and importlib.util.find_spec("xarray") is None:
        raise InputError(
            f"--out {out}: NetCDF needs xarray (pip install 'jaxcontact[data]'); .csv does not"
        )
    parameters = law_parameters(arguments) | {n: getattr(arguments, n) for n in _CONTACT}
    plot = _plot(arguments, parameters)
    function = _function(arguments, parameters)
    from .... import Status, sweep

    lanes = math.prod(np.size(values) for values in parameters.values())
    progress(f"compiling and solving {lanes:,} impacts")
    table = sweep(function, progress=False if arguments.quiet else None, **parameters)
    progress("writing")
    whole = bytes(table.to_xarray().to_netcdf(engine="scipy")) if netcdf else table.to_csv
    files = {out: whole}
    if plot is not None:
        from ....extend import render
        from ....plot import sweep as draw

        def fill(figure: Any) -> None:
            draw(table, field=arguments.field, ax=figure.subplots())

        files[plot] = render(fill, (6.4, 4.4), plot)
    shown: list[object] = [table]
    beyond, counts = _beyond(table), table.status_counts()
    if beyond:
        shown.append(
            f"  beyond  {beyond:,} separated impacts have numbers too large for double precision"
        )
    data = {
        "axes": table.axes,
        "fields": list(table.fields),
        "status": {Status(code).name: n for code, n in counts.items()},
        "beyond": beyond,
        "complete": table.complete,
        "files": list(map(str, files)),
    }
    poor = Status.NOT_CONVERGED in counts or beyond or not table.complete
    return Output(shown, data, files, 1 if poor else 0)


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
    from ....extend import POSITIVE, SPEED, describe

    own = describe(arguments.law).parameters
    exponent = exponent_asked(arguments)

    def impact_of(**numbers: Any) -> Impact:
        law = get_law(arguments.law, **{name: numbers[name] for name in own})
        contact = Contact(numbers["mass"], numbers["stiffness"], exponent)
        return impact(law, contact, numbers["velocity"])

    impact_of.__name__ = arguments.law
    allowed = {**own, "mass": POSITIVE, "stiffness": POSITIVE, "velocity": SPEED}
    for name, value in parameters.items():
        if isinstance(value, float) and not allowed[name].holds(value):
            raise InputError(f"{name} must be in {allowed[name]}, but is {value:g}")
    return impact_of

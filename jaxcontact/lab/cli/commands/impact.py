"""`jaxcontact impact`: one impact in numbers, and as a figure."""

from __future__ import annotations

import argparse
import math
import sys

from ....extend import FIGURES, Stages, quantity, text_table
from ..law import exponent_asked, law_options, law_parameters
from ..options import InputError, Output, input_errors, output_path

_SAMPLES = 400

SUMMARY = "one impact in numbers, and as a figure"

DESCRIPTION = """\
One free impact, from touch to separation: restitution, rebound speed, duration, compression time,
largest indentation and force, and the energy lost.
"""

EPILOG = """\
example: jaxcontact impact --law hu_guo --e 0.7 --mass 1 --stiffness 1.4e8 --velocity 4.2

exit codes: 0 done; 1 the impact or its picture could not be solved to accuracy; 2 bad input,
nothing written.
"""

OPTIONS = f"""{law_options()}
--plot FILE | | draw force over indentation and time, and speed over time; .png, .pdf or .svg
"""


def run(arguments: argparse.Namespace, progress: Stages) -> Output:
    """Return the numbers of an impact, and its picture."""
    plot = output_path("--plot", arguments.plot, FIGURES) if arguments.plot else None
    progress("compiling and solving the impact")
    from .... import Contact, Status, get_law, impact, trajectory
    from ....extend import NUMBERS, render

    parameters = law_parameters(arguments)
    exponent, velocity = exponent_asked(arguments), arguments.velocity
    with input_errors():
        law = get_law(arguments.law, **parameters)
        contact = Contact(arguments.mass, arguments.stiffness, exponent)
        hit = impact(law, contact, velocity, throw=False)
    status = Status(int(hit.status))
    numbers = {name: float(getattr(hit, name)) for name in NUMBERS}
    words = {name: name.replace("_", " ") for name in numbers}
    beyond = [words[name] for name, x in numbers.items() if not math.isfinite(x)]
    if status == Status.INVALID_INPUT:
        raise InputError("a parameter is out of its range")
    # Extreme arguments.
    if beyond and status == Status.SEPARATED:
        raise InputError(f"{', '.join(beyond)}: too large to be written in double precision")
    complete, files = status != Status.NOT_CONVERGED, {}
    e = "" if arguments.e is None else f", e = {arguments.e:g}"
    if plot is not None:
        from ....plot import impact as draw

        progress("compiling and drawing the trajectory")
        label = f"{arguments.law}{e}, {velocity:g} m/s"
        try:
            path = trajectory(law, contact, velocity, samples=_SAMPLES)
            files[plot] = render(
                lambda figure: draw(path, hit, ax=figure.subplots(1, 3), label=label),
                *((10.0, 3.4), plot),
            )
        except ValueError as error:
            # The trajectory comes from another solve than the numbers, which may not converge.
            print(f"no picture: {error}", file=sys.stderr)
            complete = False
    rows = [("parameter e", f"{arguments.e:.9g}")] if e else []
    rows += [(words[name], quantity(name, f"{value:.9g}")) for name, value in numbers.items()]
    rows.append(("status", status.name.lower().replace("_", " ")))
    head = f"{arguments.law} at {velocity:g} m/s (method {hit.method})"
    data = {
        "law": arguments.law,
        "parameters": parameters,
        "contact": {
            "mass": arguments.mass,
            "stiffness": arguments.stiffness,
            "exponent": exponent,
        },
        "velocity": velocity,
        **numbers,
        "status": status.name,
        "method": hit.method,
    }
    named = "mass", "stiffness", "velocity", *numbers
    data["units"] = {name: unit for name in named if (unit := quantity(name, "").strip())}
    return Output([head, *text_table(rows, indent=2)], data, files, 0 if complete else 1)

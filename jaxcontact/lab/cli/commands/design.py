"""`jaxcontact design`: the next measurements."""

from __future__ import annotations

import argparse
import functools
import re
from typing import Any

from ....extend import Stages
from ..law import add_law_and_contact, contact_asked, exponent_asked, law_parameters
from ..options import InputError, assignment, input_errors, number, positive, print_json, span

SUMMARY = "plan the next measurements"

DESCRIPTION = """\
Plan the readings that best determine the parameters of a law and a contact, or that distinguish two
laws. The plan lists quantities, closing speeds among those available, and numbers of readings.
"""

EPILOG = """\
example: jaxcontact design --law hu_guo --e 0.7 --mass 0.05 --stiffness 1e6 \\
             --speeds 0.2:4:20:log --sigma e=0.01 --sigma duration=0.02 --readings 12

--sigma is the standard deviation of one reading: of e itself, of duration and max_force relative to
their size. Only quantities with a sigma are read. The law and the contact are your best guess.

With --against, λ is the least Σ ((difference of the laws)/sigma)² over the parameters of the other
law. λ = 40 distinguishes the laws. λ = 0 means that the other law can give the same readings: read
another quantity, or hold a known number.

exit codes: 0 done; 2 bad input.
"""

_QUANTITIES = ("e", "duration", "max_force")


def add_options(parser: argparse.ArgumentParser) -> None:
    form = "NUMBER", "c=1e6"
    add_law_and_contact(parser, number=number, size=positive, form=form, velocity=False)
    parser.add_argument(
        "--speeds",
        metavar="RANGE",
        type=span,
        required=True,
        help="available closing speeds in m/s: FROM:TO:COUNT or FROM:TO:COUNT:log",
    )
    parser.add_argument(
        "--sigma",
        metavar="QUANTITY=NUMBER",
        type=functools.partial(assignment, read=positive, form="NUMBER"),
        action="append",
        required=True,
        help=f"of {', '.join(_QUANTITIES)}; may be repeated",
    )
    parser.add_argument(
        "--readings", metavar="N", type=int, default=8, help="number of readings (default: 8)"
    )
    parser.add_argument(
        "--goal",
        metavar="NAME",
        default="all",
        help='a parameter ("law.e", "contact.stiffness"), or all of them (default)',
    )
    parser.add_argument("--against", metavar="LAW", help="a law to distinguish from --law, instead")
    parser.add_argument(
        "--hold",
        metavar="NAME",
        action="append",
        help="a known number, besides the mass; may be repeated",
    )


def run(arguments: argparse.Namespace, progress: Stages) -> int:
    """Design the readings and print them. Raises InputError."""
    progress("compiling and planning")
    import numpy as np

    from .... import get_law
    from ....extend import constant_laws, did_you_mean
    from ...design import design

    parameters = law_parameters(arguments)
    contact = contact_asked(arguments, exponent_asked(arguments))
    sigma = dict(arguments.sigma)
    for name in sigma:
        if name not in _QUANTITIES:
            raise InputError(
                f"--sigma {name}: the quantities are {', '.join(_QUANTITIES)}."
                f"{did_you_mean(name, _QUANTITIES)}"
            )
    goal: Any = arguments.goal
    if arguments.against is not None:
        if arguments.against not in constant_laws():
            raise InputError(
                f"--against: must be a law with one parameter e ({', '.join(constant_laws())})."
                f"{did_you_mean(arguments.against, constant_laws())}"
            )
        goal = get_law(arguments.against, e=parameters.get("e", 0.7))
    fixed = ("mass", *(arguments.hold or ()))
    with input_errors(_in_options):
        plan = design(
            get_law(arguments.law, **parameters),
            contact,
            sigma=sigma,
            candidates=np.atleast_1d(arguments.speeds),
            readings=arguments.readings,
            goal=goal,
            fixed=fixed,
        )
    if arguments.json:
        print_json(
            {
                "velocity": plan.velocity,
                "quantity": plan.quantity,
                "standard_errors": plan.standard_errors,
                "even": plan.even,
                "noncentrality": plan.noncentrality,
                "meaning": plan.meaning,
            }
        )
    else:
        print(plan)
    return 0


def _in_options(text: str) -> str:
    text = text.replace("`candidates`", "`speeds`").replace("`fixed`", "`hold`")
    return re.sub(r"(Argument )?`(speeds|readings|goal|hold|sigma)`", r"--\2", text)

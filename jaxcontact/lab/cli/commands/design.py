"""`jaxcontact design`: the next measurements."""

from __future__ import annotations

import argparse
from typing import Any

from ....extend import Stages
from ..law import contact_asked, exponent_asked, law_options, law_parameters
from ..options import InputError, Output, fields, input_errors, naming

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

OPTIONS = f"""{law_options(velocity=False)}
--speeds RANGE | range, required | available closing speeds in m/s: FROM:TO:COUNT or
    FROM:TO:COUNT:log
--sigma QUANTITY=NUMBER ... | positive, required | of {", ".join(_QUANTITIES)}; may be repeated
--readings N | count, = 8 | number of readings (default: 8)
--goal NAME | = all | a parameter ("law.e", "contact.stiffness"), or all of them (default)
--against LAW | | a law to distinguish from --law, instead
--hold NAME ... | | a known number, besides the mass; may be repeated
"""


def run(arguments: argparse.Namespace, progress: Stages) -> Output:
    """Return the designed readings."""
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
    with input_errors(naming("speeds readings goal hold sigma", candidates="speeds", fixed="hold")):
        plan = design(
            get_law(arguments.law, **parameters),
            contact,
            sigma=sigma,
            candidates=np.atleast_1d(arguments.speeds),
            readings=arguments.readings,
            goal=goal,
            fixed=("mass", *arguments.hold),
        )
    names = "velocity quantity standard_errors even noncentrality meaning"
    return Output([plan], fields(plan, names))

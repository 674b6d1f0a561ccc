"""`jaxcontact export`: settings for another simulator."""

from __future__ import annotations

import argparse
import re
from typing import TYPE_CHECKING, Any

from ....extend import Stages
from ..law import contact_asked, exponent_asked, law_options, law_parameters
from ..options import InputError, Output, fields, input_errors, naming

if TYPE_CHECKING:
    from .... import Contact, Export

SUMMARY = "settings for another simulator"

DESCRIPTION = """\
Print settings with which another simulator delivers the restitution of a law, as lines to paste.
The output includes the range of closing speeds over which they hold, and the error outside it.
"""

EPILOG = """\
examples:
  jaxcontact export --law hu_guo --e 0.7 --mass 1 --stiffness 1e6 --velocity 2 --engine drake
  jaxcontact export --from calibration.json --mass 0.05 --stiffness 1e6 --engine mujoco

--velocity FROM:TO:COUNT gives the parameters that minimise the largest error of e over these
speeds. With --from, the default is the measured range. Mass and stiffness then come from the
calibration; give them here if it was made without them.

Engines and their options: bullet, mujoco, newton; adams (--option length=mm,
--option d=1e-5); chrono and yade (--radius, --option poisson_ratio=0.3);
mercurydpm (--radius for a law with a slope);
drake (--option discrete_contact_approximation=sap); exudyn (--option impact_model=1);
lammps (--radius, --option damping=viscoelastic, or mass_velocity with hooke); simbody (--radius).
For isaac, physx and genesis the command describes their contacts.

--time-step 0.002 prints the range of e at this step, over the phase of the step at touch, and the
shortest contact that keeps e within --within. Steps of robot simulators do not resolve most
contacts. It is available for drake, lammps, mercurydpm, mujoco and newton.

exit codes: 0 done; 2 bad input, or a restitution that the engine's law cannot deliver.
"""

OPTIONS = f"""
--engine NAME | required | the simulator; see below
--from FILE | | a calibration, instead of a law
{law_options(required=False, velocity=False)}
--velocity V | range | closing speed in m/s, or FROM:TO:COUNT[:log]
--radius M | positive | effective radius in m, R1 R2/(R1+R2)
--option NAME=VALUE ... | value | another option of the engine; may be repeated
--time-step S | positive | also print e at steps of S seconds
--within E | positive, = 0.01 | error of e up to which the parameters hold (default: 0.01)
"""


def run(arguments: argparse.Namespace, progress: Stages) -> Output:
    """Return the export, with the speeds over which it holds."""
    progress("compiling and inverting the engine's law")
    from .... import export
    from ....extend import wrapped

    law, contact = _law_and_contact(arguments)
    options = dict(arguments.option)
    if arguments.radius is not None:
        options["radius"] = arguments.radius
    with input_errors(_in_options):
        result = export(law, contact, arguments.velocity, engine=arguments.engine, **options)
        progress("searching the speeds over which it holds")
        holds = result.holds(arguments.within)
        at_step = None
        if arguments.time_step is not None:
            at_step = result.at_time_step(arguments.time_step, arguments.within)
    shown = [*_lines(result), holds, ""] + ([] if at_step is None else [at_step, ""])
    for head, text in (("Limit", result.limit), ("Source", result.source)):
        shown += wrapped(head, text, indent=9)
    names = "engine model snippet parameters units velocity target delivered error duration"
    data = fields(result, f"{names} time_step expected_error")
    span = {"within": holds.within, "from": holds.low, "to": holds.high}
    data["holds"] = span | fields(holds, "velocity target delivered")
    data |= fields(result, "limit source")
    if at_step is not None:
        data["at_time_step"] = vars(at_step)
    return Output(shown, data)


def _law_and_contact(arguments: argparse.Namespace) -> tuple[Any, Contact | None]:
    from .... import get_law

    file = getattr(arguments, "from")
    if (file is None) == (arguments.law is None):
        raise InputError("give either --law, with its parameters, or --from FILE")
    if arguments.law is None:
        from ...calibration.summary import load_calibration

        with input_errors():
            calibration = load_calibration(file)
        if arguments.mass is None and arguments.stiffness is None:
            return calibration, None
        # Numbers not given here come from the calibration; otherwise they are required.
        for name in ("mass", "stiffness"):
            if getattr(arguments, name) is None and name in calibration.given:
                setattr(arguments, name, float(getattr(calibration.contact, name)))
        return calibration, contact_asked(arguments, arguments.exponent or 1.5)
    options = law_parameters(arguments)
    if arguments.velocity is None:
        raise InputError("--velocity is needed: e of the engine may depend on it")
    contact = contact_asked(arguments, exponent_asked(arguments))
    with input_errors():
        return get_law(arguments.law, **options), contact


def _in_options(text: str) -> str:
    text = text.replace("Give `contact=Contact(mass, stiffness)`", "Give --mass and --stiffness")
    text = text.replace("Argument `contact` is needed: this calibration", "the calibration")
    text = naming("mass stiffness radius engine velocity law")(text)
    text = re.sub(r"Arguments? (--|`)", r"\1", text).replace(", but is None.", "")
    return re.sub(r"`(\w+)`", r"--option \1", text) if "engine" in text else text


def _lines(result: Export) -> list[Any]:
    from ....extend import quantity, text_table

    rows = [(name, f"{x:.9g} {result.units[name]}") for name, x in result.parameters.items()]
    rows.append(("duration of contact", quantity("duration", f"{result.duration:.4g}")))
    step = "unknown: the export uses the formula of the engine, which was not run"
    if result.time_step is not None and result.expected_error is not None:
        error = f"for an error of e of {result.expected_error:.1%}"
        step = f"{result.time_step:.3g} s or less, {error}"
    rows.append(("time step", step))
    lines = [f"{result.engine}: {result.model}", "", *result.snippet.splitlines(), ""]
    return [*lines, *text_table(rows, indent=2), *result.by_speed(), ""]

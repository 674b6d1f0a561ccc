"""The command `jaxcontact`: calibrate, laws, impact, sweep, scene, paper."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from typing import Any

from .._progress import Stages
from . import _calibrate, _impact, _laws, _paper, _scene, _sweep
from ._cache import VARIABLE, keep_programs
from ._options import InputError

# Each has SUMMARY, DESCRIPTION and EPILOG, `add_options(parser)` and `run(arguments, progress)`.
_COMMANDS = {
    "calibrate": _calibrate,
    "laws": _laws,
    "impact": _impact,
    "sweep": _sweep,
    "scene": _scene,
    "paper": _paper,
}

_EPILOG = f"""\
exit codes: 0 done; 1 done, but something did not converge; 2 bad input, and nothing was written.

Compiled programs are kept for the next command in the user's cache folder; {VARIABLE}
names another one, and switches it off where it is empty, as --no-cache does.

`jaxcontact COMMAND --help` tells everything about a command.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code: 0, 1 (not converged) or 2 (bad input).

    `argv` are the arguments without the program's name, those of the process if None. Switches JAX
    to double precision for the process. As usual for argparse, `--help` and misspelt options raise
    SystemExit.
    """
    style: dict[str, Any] = {
        "formatter_class": argparse.RawDescriptionHelpFormatter,
        "allow_abbrev": False,
    }
    words = "Contact laws: what they deliver, impacts, scenes, and parameters from bounces."
    parser = argparse.ArgumentParser("jaxcontact", description=words, epilog=_EPILOG, **style)
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for name, command in _COMMANDS.items():
        texts = {"description": command.DESCRIPTION, "epilog": command.EPILOG}
        own = commands.add_parser(name, help=command.SUMMARY, **texts, **style)
        own.add_argument("--quiet", action="store_true", help="no progress on stderr")
        own.add_argument(
            "--no-cache", action="store_true", help="keep no compiled programs for the next command"
        )
        command.add_options(own)
        own.set_defaults(run=command.run)
    arguments = parser.parse_args(argv)

    # Imported when the arguments are known to be good: --help need not wait for JAX.
    import jax

    jax.config.update("jax_enable_x64", True)
    if not arguments.no_cache:
        keep_programs()
    try:
        code = arguments.run(arguments, Stages(quiet=arguments.quiet))
        sys.stdout.flush()
        return code
    except BrokenPipeError:
        # The reader (`| head`, say) has read enough. What Python still flushes at its end goes
        # nowhere, instead of into a second error.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (InputError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2

"""The command `jaxcontact`: calibrate, laws, impact, sweep, paper."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

from . import _calibrate, _impact, _laws, _paper, _sweep
from ._options import InputError

_EPILOG = """\
exit codes: 0 done; 1 done, but something did not converge; 2 bad input, and nothing was written.

`jaxcontact COMMAND --help` tells everything about a command.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code: 0, 1 (not converged) or 2 (bad input).

    `argv` are the arguments without the program's name, those of the process if None. Switches JAX
    to double precision for the process. As usual for argparse, `--help` and misspelt options raise
    SystemExit.
    """
    parser = argparse.ArgumentParser(
        prog="jaxcontact",
        description="Contact laws: what they deliver, impacts, and parameters from bounces.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for command in (_calibrate, _laws, _impact, _sweep, _paper):
        command.add_parser(commands)
    arguments = parser.parse_args(argv)

    # Imported when the arguments are known to be good: --help need not wait for JAX.
    import jax

    jax.config.update("jax_enable_x64", True)
    try:
        code = arguments.run(arguments)
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

"""The command `jaxcontact` with its subcommands.

They are calibrate, fit, design, laws, impact, sweep, scene, export, explore and paper.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Sequence

from .._cache import VARIABLE
from .._text.progress import Stages
from .commands import calibrate, design, explore, export, fit, impact, laws, paper, scene, sweep
from .options import InputError
from .parser import SHELLS, Completion, Parser, Version

# Each has SUMMARY, DESCRIPTION and EPILOG, `add_options(parser)` and `run(arguments, progress)`.
_COMMANDS = {
    "calibrate": calibrate,
    "fit": fit,
    "design": design,
    "export": export,
    "explore": explore,
    "laws": laws,
    "impact": impact,
    "sweep": sweep,
    "scene": scene,
    "paper": paper,
}

_INTERRUPTED = 130  # shell convention: 128 plus the signal number

_EPILOG = f"""\
exit codes: 0 done; 1 done, but something did not converge; 2 bad input, and nothing was written;
{_INTERRUPTED} interrupted.

Results go to stdout, as text or with --json as JSON; progress and errors go to stderr.

Compiled programs are kept in the user's cache folder for the next command. {VARIABLE}
sets another folder; an empty value switches the cache off, as --no-cache does.

completion: `jaxcontact --completion bash` (or zsh) prints a script for your shell to source.

`jaxcontact COMMAND --help` describes a command.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code: 0, 1 (not converged) or 2 (bad input).

    `argv` are the arguments without the program's name, those of the process if None. Switches JAX
    to double precision for the process. As usual for argparse, `--help` and misspelt options raise
    SystemExit.
    """
    arguments = _parser().parse_args(argv)

    # Imported after the arguments are checked, so that --help does not wait for JAX.
    import jax

    jax.config.update("jax_enable_x64", True)
    if not arguments.no_cache:
        keep_programs()
    try:
        code = arguments.run(arguments, Stages(quiet=arguments.quiet))
        sys.stdout.flush()
        return code
    except BrokenPipeError:
        # The reader (such as `| head`) has closed the pipe. Python's final flush goes to the null
        # device, which avoids a second error.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return _INTERRUPTED
    except (InputError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def _parser() -> Parser:
    words = (
        "Contact laws: delivered restitution, impacts, scenes, and parameters from measurements."
    )
    parser = Parser("jaxcontact", description=words, epilog=_EPILOG)
    parser.add_argument("--version", action=Version, nargs=0, help="print the version and exit")
    parser.add_argument(
        "--completion", action=Completion, choices=SHELLS, help="print a completion script and exit"
    )
    commands = parser.add_subparsers(metavar="COMMAND", dest="command", required=True)
    for name, command in _COMMANDS.items():
        texts = {"description": command.DESCRIPTION, "epilog": command.EPILOG}
        parser_of_command = commands.add_parser(name, help=command.SUMMARY, **texts)
        command.add_options(parser_of_command)
        general = parser_of_command.add_argument_group("options of every command")
        general.add_argument(
            "--json", action="store_true", help="print the result as JSON instead of text"
        )
        general.add_argument("--quiet", action="store_true", help="no progress on stderr")
        general.add_argument(
            "--no-cache", action="store_true", help="keep no compiled programs for the next command"
        )
        parser_of_command.set_defaults(run=command.run)
    return parser


def keep_programs() -> None:
    """Keep compiled programs for the next command.

    Programs that cannot be written or read are compiled as without a cache, without a message.
    """
    from .._cache import cache

    try:
        cache()
    except ValueError:
        return
    for verb in ("reading", "writing"):
        warnings.filterwarnings("ignore", f"Error {verb} persistent compilation cache entry")

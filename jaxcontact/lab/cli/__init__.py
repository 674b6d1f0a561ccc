"""The command `jaxcontact` with its subcommands.

They are calibrate, fit, design, laws, impact, sweep, scene, export, explore and paper.
"""

from __future__ import annotations

import argparse
import difflib
import os
import re
import shlex
import sys
import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NoReturn

from ...extend import Stages, write_all
from .commands import calibrate, design, explore, export, fit, impact, laws, paper, scene, sweep
from .options import InputError, add_options, print_json

SHELLS = ("bash", "zsh")

_CHOICE = re.compile(r"invalid choice: '(.*?)' \(choose from (.*)\)")

# Each has SUMMARY, DESCRIPTION, EPILOG and OPTIONS, and `run(arguments, progress)`, which returns
# its output or raises InputError or OSError.
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

_GENERAL = """
# options of every command
--json | flag | print the result as JSON instead of text
--quiet | flag | no progress on stderr
--no-cache | flag | keep no compiled programs for the next command
"""

_INTERRUPTED = 130  # shell convention: 128 plus the signal number

_EPILOG = f"""\
exit codes: 0 done; 1 done, but something did not converge; 2 bad input, and nothing was written;
{_INTERRUPTED} interrupted.

Results go to stdout, as text or with --json as JSON; progress and errors go to stderr.

Compiled programs are kept in the user's cache folder for the next command. JAXCONTACT_CACHE
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
    arguments.line = shlex.join(["jaxcontact", *(sys.argv[1:] if argv is None else argv)])

    # Imported after the arguments are checked, so that --help does not wait for JAX.
    import jax

    jax.config.update("jax_enable_x64", True)
    if not arguments.no_cache:
        keep_programs()
    try:
        output = arguments.run(arguments, Stages(quiet=arguments.quiet))
        write_all(output.files)
        if arguments.json:
            print_json(output.data)
        else:
            print(*output.shown, sep="\n")
        sys.stdout.flush()
        return output.code
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
    parser.commands = commands.choices
    for name, command in _COMMANDS.items():
        texts = {"description": command.DESCRIPTION, "epilog": command.EPILOG}
        parser_of_command = commands.add_parser(name, help=command.SUMMARY, **texts)
        add_options(parser_of_command, command.OPTIONS + _GENERAL)
        parser_of_command.set_defaults(run=command.run)
    return parser


def keep_programs() -> None:
    """Keep compiled programs for the next command.

    Programs that cannot be written or read are compiled as without a cache, without a message.
    """
    from ... import cache

    try:
        cache()
    except ValueError:
        return
    for verb in ("reading", "writing"):
        warnings.filterwarnings("ignore", f"Error {verb} persistent compilation cache entry")


class Parser(argparse.ArgumentParser):
    """A parser whose messages suggest the probable meaning."""

    def __init__(self, *arguments: Any, **how: Any):
        how = {"formatter_class": argparse.RawDescriptionHelpFormatter, "allow_abbrev": False} | how
        super().__init__(*arguments, **how)
        self._given: list[str] = []
        self.commands: Mapping[Any, Parser] = {}

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse as argparse does, and keep the arguments for messages."""
        self._given = list(sys.argv[1:] if args is None else args)
        return super().parse_known_args(args, namespace)

    def parse_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:
        """Parse as argparse does, but report an unknown option from its subcommand."""
        parsed, unknown = self.parse_known_args(args, namespace)
        if unknown:
            command = self.commands.get(getattr(parsed, "command", None), self)
            command.error(command.unknown(unknown))
        return parsed

    def unknown(self, arguments: Sequence[str]) -> str:
        """Return the message for unknown arguments."""
        options = self._options()
        guesses = [closest(argument.partition("=")[0], options) for argument in arguments]
        guess = next((f"; did you mean {name}?" for name in guesses if name), "")
        return f"unknown: {' '.join(arguments)}{guess}"

    def error(self, message: str) -> NoReturn:
        """Print the message, with a suggestion for a misspelt word; exit with 2."""
        options = [word for word in self._given if word.startswith("--")]
        odd = [word for word in options if word.partition("=")[0] not in self._options()]
        # A misspelt option explains why another one is missing, so it is reported first.
        if odd and "required" in message:
            message = self.unknown(odd)
        if match := _CHOICE.search(message):
            choices = [choice.strip(" '") for choice in match[2].split(",")]
            guess = closest(match[1], choices)
            message += f"; did you mean {guess}?" if guess else ""
        self.exit(2, f"error: {message}\n`{self.prog} --help` lists all options\n")

    def _options(self) -> list[str]:
        return [name for action in self._actions for name in action.option_strings]


def closest(word: str, words: Iterable[str]) -> str | None:
    """Return the known word closest to a misspelt one, or None."""
    matches = difflib.get_close_matches(word, list(words), n=1)
    return matches[0] if matches else None


class Version(argparse.Action):
    """Print the version of the package, and exit."""

    def __call__(self, parser: argparse.ArgumentParser, *unused: Any) -> NoReturn:
        from importlib.metadata import version

        print(f"jaxcontact {version('jaxcontact')}")
        sys.exit(0)


class Completion(argparse.Action):
    """Print the shell script that completes commands, options and names; then exit."""

    def __call__(self, parser: Any, namespace: Any, shell: Any, *unused: Any) -> NoReturn:
        try:
            import shtab
        except ImportError:
            parser.exit(2, "error: --completion needs: pip install 'jaxcontact[completion]'\n")
        from ... import list_laws
        from ...engines import engines

        names = {"law": list_laws(), "engine": engines()}
        for command in parser.commands.values():
            for action in command._actions:
                if action.metavar == "FILE":
                    action.complete = shtab.FILE
                elif action.metavar == "DIR":
                    action.complete = shtab.DIRECTORY
                elif action.dest in names:
                    action.choices = names[action.dest]
        print(shtab.complete(parser, shell))
        sys.exit(0)

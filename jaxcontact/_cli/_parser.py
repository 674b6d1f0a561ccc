"""The parser of all commands: suggestions for what is misspelt, the version, completion."""

from __future__ import annotations

import argparse
import difflib
import re
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn

SHELLS = ("bash", "zsh")

_CHOICE = re.compile(r"invalid choice: '(.*?)' \(choose from (.*)\)")


class Parser(argparse.ArgumentParser):
    """A parser whose messages say what was probably meant."""

    def __init__(self, *arguments: Any, **how: Any):
        how = {"formatter_class": argparse.RawDescriptionHelpFormatter, "allow_abbrev": False} | how
        super().__init__(*arguments, **how)

    def parse_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:
        """As argparse does, but an unknown option is told by the command that lacks it."""
        found, unknown = self.parse_known_args(args, namespace)
        if unknown:
            own = self._commands().get(getattr(found, "command", None), self)
            own.error(own.unknown(unknown))
        return found

    def unknown(self, arguments: Sequence[str]) -> str:
        """The message for arguments that are not understood."""
        known = [name for action in self._actions for name in action.option_strings]
        guesses = [meant(argument.partition("=")[0], known) for argument in arguments]
        guess = next((f"; did you mean {one}?" for one in guesses if one), "")
        return f"unknown: {' '.join(arguments)}{guess}"

    def error(self, message: str) -> NoReturn:
        """Print usage and the message, with a suggestion for a bad choice; exit with 2."""
        if found := _CHOICE.search(message):
            choices = [choice.strip(" '") for choice in found[2].split(",")]
            guess = meant(found[1], choices)
            message += f"; did you mean {guess}?" if guess else ""
        super().error(message)

    def _commands(self) -> dict[Any, Parser]:
        found: dict[Any, Parser] = {}
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                found |= action.choices
        return found


def meant(given: str, known: Iterable[str]) -> str | None:
    """The one of the known words that is most like a misspelt one; None where none is."""
    found = difflib.get_close_matches(given, list(known), n=1)
    return found[0] if found else None


class Version(argparse.Action):
    """Print the version of the package, and end."""

    def __call__(self, parser: argparse.ArgumentParser, *unused: Any) -> NoReturn:
        from importlib.metadata import version

        parser.exit(0, f"jaxcontact {version('jaxcontact')}\n")


class Completion(argparse.Action):
    """Print what makes a shell complete the commands, their options, and names; and end."""

    def __call__(self, parser: Any, namespace: Any, shell: Any, *unused: Any) -> NoReturn:
        try:
            import shtab
        except ImportError:
            parser.exit(2, "error: --completion needs: pip install 'jaxcontact[completion]'\n")
        from .._export import engines
        from .._laws import list_laws

        names = {"law": list_laws(), "engine": engines()}
        for own in parser._commands().values():
            for action in own._actions:
                if action.metavar == "FILE":
                    action.complete = shtab.FILE
                elif action.metavar == "DIR":
                    action.complete = shtab.DIRECTORY
                elif action.dest in names:
                    action.choices = names[action.dest]
        parser.exit(0, shtab.complete(parser, shell) + "\n")

"""The parser of all commands: suggestions for misspelt words, the version, completion."""

from __future__ import annotations

import argparse
import difflib
import re
import sys
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn

SHELLS = ("bash", "zsh")

_CHOICE = re.compile(r"invalid choice: '(.*?)' \(choose from (.*)\)")


class Parser(argparse.ArgumentParser):
    """A parser whose messages suggest the probable meaning."""

    def __init__(self, *arguments: Any, **how: Any):
        how = {"formatter_class": argparse.RawDescriptionHelpFormatter, "allow_abbrev": False} | how
        super().__init__(*arguments, **how)
        self._given: list[str] = []

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse as argparse does, and keep the arguments for messages."""
        self._given = list(sys.argv[1:] if args is None else args)
        return super().parse_known_args(args, namespace)

    def parse_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:
        """Parse as argparse does, but report an unknown option from its subcommand."""
        found, unknown = self.parse_known_args(args, namespace)
        if unknown:
            own = self._commands().get(getattr(found, "command", None), self)
            own.error(own.unknown(unknown))
        return found

    def unknown(self, arguments: Sequence[str]) -> str:
        """Return the message for unknown arguments."""
        known = self._options()
        guesses = [meant(argument.partition("=")[0], known) for argument in arguments]
        guess = next((f"; did you mean {one}?" for one in guesses if one), "")
        return f"unknown: {' '.join(arguments)}{guess}"

    def error(self, message: str) -> NoReturn:
        """Print the message, with a suggestion for a misspelt word; exit with 2."""
        options = [given for given in self._given if given.startswith("--")]
        odd = [given for given in options if given.partition("=")[0] not in self._options()]
        # A misspelt option explains why another one is missing, so it is reported first.
        if odd and "required" in message:
            message = self.unknown(odd)
        if found := _CHOICE.search(message):
            choices = [choice.strip(" '") for choice in found[2].split(",")]
            guess = meant(found[1], choices)
            message += f"; did you mean {guess}?" if guess else ""
        self.exit(2, f"error: {message}\n`{self.prog} --help` lists all options\n")

    def _options(self) -> list[str]:
        return [name for action in self._actions for name in action.option_strings]

    def _commands(self) -> dict[Any, Parser]:
        found: dict[Any, Parser] = {}
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                found |= action.choices
        return found


def meant(given: str, known: Iterable[str]) -> str | None:
    """Return the known word closest to a misspelt one, or None."""
    found = difflib.get_close_matches(given, list(known), n=1)
    return found[0] if found else None


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
        print(shtab.complete(parser, shell))
        sys.exit(0)

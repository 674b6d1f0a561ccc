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
        parsed, unknown = self.parse_known_args(args, namespace)
        if unknown:
            command = self._commands().get(getattr(parsed, "command", None), self)
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

    def _commands(self) -> dict[Any, Parser]:
        commands: dict[Any, Parser] = {}
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                commands |= action.choices
        return commands


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
        from .._export import engines
        from .._laws import list_laws

        names = {"law": list_laws(), "engine": engines()}
        for command in parser._commands().values():
            for action in command._actions:
                if action.metavar == "FILE":
                    action.complete = shtab.FILE
                elif action.metavar == "DIR":
                    action.complete = shtab.DIRECTORY
                elif action.dest in names:
                    action.choices = names[action.dest]
        print(shtab.complete(parser, shell))
        sys.exit(0)

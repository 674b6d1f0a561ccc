"""The public names and their arguments, as lines of a file: `python -m tests.public_names`.

Run it with a release, and commit the file. tests/test_house/test_public_names.py compares the
package with it, so that no public name or argument changes unannounced.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jaxcontact as jc
from jaxcontact import jaxsim, mjx, paper, plot, systems

FILE = Path(__file__).with_suffix(".txt")
SPACES = (jc, jaxsim, mjx, paper, plot, systems)


def members() -> Iterator[tuple[str, Any, list[str]]]:
    """Full name, value and arguments of all that is public, methods after their class."""
    for module in SPACES:
        for name in dir(module):
            # Names of the package are loaded on first use.
            value, full = getattr(module, name), f"{module.__name__}.{name}"
            if name.startswith("_") or inspect.ismodule(value):
                continue
            yield full, value, arguments(value)
            methods = inspect.getmembers(value, callable) if inspect.isclass(value) else []
            for part, member in methods:
                # Members of object, tuple and Exception are not ours.
                ours = (getattr(member, "__module__", None) or "").startswith("jaxcontact")
                if ours and not part.startswith("_"):
                    yield f"{full}.{part}", member, arguments(member)[inspect.isfunction(member) :]


def names() -> dict[str, list[str]]:
    """By full name the arguments, those by keyword alone behind a star."""
    return {name: given for name, _, given in members()}


def arguments(value: object) -> list[str]:
    """Names of arguments in order."""
    if not callable(value):
        return []
    try:
        parameters = inspect.signature(value).parameters.values()
    except (TypeError, ValueError):  # of a class of another library
        return []
    listed, keyword = [], False
    for one in parameters:
        if one.kind is one.KEYWORD_ONLY and not keyword:
            listed, keyword = [*listed, "*"], True
        stars = {one.VAR_POSITIONAL: "*", one.VAR_KEYWORD: "**"}.get(one.kind, "")
        keyword |= one.kind is one.VAR_POSITIONAL
        listed.append(stars + one.name)
    return listed


def written() -> dict[str, list[str]]:
    """What the file holds."""
    lines = (line.partition("(") for line in FILE.read_text().splitlines())
    return {name: [a for a in rest.rstrip(")").split(", ") if a] for name, _, rest in lines}


if __name__ == "__main__":
    text = "".join(f"{name}({', '.join(given)})\n" for name, given in sorted(names().items()))
    FILE.write_text(text)

"""The public names and their arguments, as lines of a file: `python -m tests.public_names`.

Run it with a release, and commit the file. tests/test_house/test_public_names.py compares the
package with it, so that no public name or argument changes unannounced.
"""

from __future__ import annotations

import inspect
from pathlib import Path

import jaxcontact as jc
from jaxcontact import jaxsim, mjx, paper, plot, systems

FILE = Path(__file__).with_suffix(".txt")
SPACES = {module.__name__: module for module in (jc, jaxsim, mjx, paper, plot, systems)}


def names() -> dict[str, list[str]]:
    """By full name the arguments, those by keyword alone behind a star."""
    found: dict[str, list[str]] = {}
    for space, module in SPACES.items():
        for name in dir(module):
            value = getattr(module, name)
            if name.startswith("_") or inspect.ismodule(value):
                continue
            found[f"{space}.{name}"] = arguments(value)
            if inspect.isclass(value):
                for part, member in inspect.getmembers(value):
                    if not part.startswith("_") and inspect.isfunction(member):
                        found[f"{space}.{name}.{part}"] = arguments(member)[1:]
    return found


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

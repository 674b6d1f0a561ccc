"""Fails unless the installed package holds every file of a source tree, and its type marker."""

import sys
from importlib.metadata import distribution
from pathlib import Path

source = Path(sys.argv[1])
wanted = {
    str(path.relative_to(source))
    for path in (source / "jaxcontact").rglob("*")
    if path.is_file() and "__pycache__" not in path.parts
}
installed = {str(path) for path in distribution("jaxcontact").files or ()}
missing = sorted(wanted - installed)
if missing or "jaxcontact/py.typed" not in installed:
    sys.exit(f"not installed: {', '.join(missing) or 'jaxcontact/py.typed'}")
print(f"{len(wanted)} files installed")

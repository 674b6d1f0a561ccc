"""`jaxcontact explore`: the interactive page of laws."""

from __future__ import annotations

import argparse
import webbrowser

from ....extend import Stages, users_folder, write_all
from ..options import InputError, Output, output_path

SUMMARY = "interactive page: e, n and damping of each law"

DESCRIPTION = """\
Write an interactive page for the browser. Sliders set e, n and damping; it shows the loop of
force and indentation, the delivered restitution and the peak force. It is one file for offline use.
"""

EPILOG = """\
example: jaxcontact explore --out explore.html --no-open

exit codes: 0 done; 2 bad input.
"""

OPTIONS = """
--out FILE | | where to write the page (default: explore.html among the user's cached files)
--no-open | flag | write the page only
"""


def run(arguments: argparse.Namespace, progress: Stages) -> Output:
    """Write the page, and open it unless `--no-open` is given."""
    from ...explore import page

    if arguments.out is not None:
        file = output_path("--out", arguments.out, (".html", ".htm"))
    elif (folder := users_folder()) is not None:
        file = folder / "explore.html"
    else:
        raise InputError("--out is needed, as no cached files are kept")
    write_all({file: page().encode()})
    opened = not arguments.no_open and webbrowser.open(file.resolve().as_uri())
    shown = f"{file}{'' if opened else ': open it in a browser'}"
    return Output([shown], {"file": str(file), "opened": opened})

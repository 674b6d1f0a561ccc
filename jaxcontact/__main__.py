"""``python -m jaxcontact``: the command line without its script."""

import sys

from .lab.cli import main

if __name__ == "__main__":
    sys.exit(main())

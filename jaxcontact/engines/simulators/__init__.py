"""The simulators, one family per file. Every file here is loaded and registers its engines."""

import importlib as _importlib
import pkgutil as _pkgutil

for _file in _pkgutil.iter_modules(__path__):
    _importlib.import_module(f"{__name__}.{_file.name}")

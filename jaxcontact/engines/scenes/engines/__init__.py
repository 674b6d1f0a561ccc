"""The engines for whole scenes, one per file. Every file is loaded and registers its engine."""

import importlib as _importlib
import pkgutil as _pkgutil

for _file in _pkgutil.iter_modules(__path__):
    _importlib.import_module(f"{__name__}.{_file.name}")

"""An extension of griffe that reads classes of results for the reference without running code.

The public class takes its docstring from a plain data class (`__doc__ = Data.__doc__`), and its
methods from functions (`interval = interval`).
"""

import griffe


class Results(griffe.Extension):
    """The extension: sets the docstring of such a class and the function of such a method."""

    def on_package(self, *, pkg, loader, **unused):
        for module in _modules(pkg):
            for cls in module.classes.values():
                if not cls.is_alias:
                    _complete(cls, loader.modules_collection)


def _modules(module):
    yield module
    for inner in module.modules.values():
        if not inner.is_alias:
            yield from _modules(inner)


def _complete(cls, known):
    for name, member in list(cls.members.items()):
        value = str(member.value) if member.is_attribute and member.value is not None else ""
        if name == "__doc__" and value.endswith(".__doc__"):
            cls.docstring = known[cls.resolve(value.removesuffix(".__doc__"))].docstring
        elif value == name and name in cls.module.members:
            cls.set_member(name, griffe.Alias(name, cls.module.resolve(name), parent=cls))

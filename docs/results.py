"""An extension of griffe that reads results and keywords for the reference without running code.

The public class takes its docstring from a plain data class (`__doc__ = Data.__doc__`), and its
methods from functions (`interval = interval`). A ready-made fit takes keywords of `fit`
(`@takes(FitKeywords)`). A name that a function shares with its module, as `impact`, is that of the
function.
"""

import ast

import griffe


class Results(griffe.Extension):
    """The extension: sets docstrings, functions of methods, and keywords in signatures."""

    def on_package(self, *, pkg, loader, **unused):
        for module in _modules(pkg):
            for cls in module.classes.values():
                if not cls.is_alias:
                    _complete(cls, loader.modules_collection)
            for function in module.functions.values():
                if not function.is_alias:
                    _show_keywords(function, loader.modules_collection)
        known = loader.modules_collection
        for name, member in list(pkg.members.items()):
            path = member.target_path if member.is_alias else ""
            while path.startswith("jaxcontact.") and name in known[path].members:
                path = f"{path}.{name}"
                pkg.set_member(name, griffe.Alias(name, path))


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


def _show_keywords(function, known):
    for decorator in function.decorators:
        call = ast.parse(str(decorator.value), mode="eval").body
        if not isinstance(call, ast.Call) or ast.unparse(call.func) != "takes":
            continue
        passed = known["jaxcontact._fit.fit.fit"].parameters
        changed = {one.arg: ast.unparse(one.value) for one in call.keywords}
        del function.parameters["how"]
        for name in known[f"jaxcontact._fit.fit.{ast.unparse(call.args[0])}"].attributes:
            shown = griffe.Parameter(
                name,
                kind=griffe.ParameterKind.keyword_only,
                default=changed.get(name, passed[name].default),
            )
            function.parameters.add(shown)

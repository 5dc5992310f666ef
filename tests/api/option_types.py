"""Keywords of verbs for editors and type checkers, made of the settings: ``python -m tests.api.option_types``.

A verb says ``**options: Unpack[IdentifyOptions]``: a dictionary with a key for each field of its settings. It stands in
a stub, which no program loads. A field that the command line reads as text takes the text too.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from collections import defaultdict
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

from tests.sources import SOURCE

from rotorid.settings.keywords import settings_of
from rotorid.settings.option import option_of

STUB = SOURCE / "settings" / "option_types.pyi"
_FROM = re.compile(r"from (\S+) import (\w+) as")
HEAD = '"""Options of the verbs as keywords, for editors; ``tests.api.option_types`` writes this."""\n\n'


def verbs() -> dict[Callable[..., Any], type[Any]]:
    """Public functions that take options, those of ``rotorid`` itself first, and the classes of their settings."""
    faces = sorted(SOURCE.rglob("__init__.pyi"), key=lambda face: len(face.parts))
    listed = [found for face in faces for found in _FROM.findall(face.read_text(encoding="utf-8"))]
    functions = [getattr(importlib.import_module(module), name) for module, name in dict.fromkeys(listed)]
    found = {function: settings_of(function) for function in functions if inspect.isfunction(function)}
    return {inspect.unwrap(function): kind for function, kind in found.items() if kind is not None}


def name_of(kind: type[Any]) -> str:
    """The dictionary of a class of settings.

    Examples
    --------
    >>> from rotorid.settings import VerifySettings
    >>> name_of(VerifySettings)
    'VerifyOptions'
    """
    return kind.__name__.replace("Settings", "Options")


def written() -> str:
    """The stub as the settings are now."""
    imports: defaultdict[str, set[str]] = defaultdict(set, {"typing": {"TypedDict"}})
    bodies = [_dictionary(kind, imports) for kind in dict.fromkeys(verbs().values())]
    lines = {module: f"from {module} import {', '.join(sorted(names))}" for module, names in sorted(imports.items())}
    own = [line for module, line in lines.items() if module.startswith("rotorid.")]
    others = [line for module, line in lines.items() if not module.startswith("rotorid.")]
    return HEAD + "\n".join([*others, "", *own, "", *bodies])


def _dictionary(kind: type[Any], imports: defaultdict[str, set[str]]) -> str:
    """A dictionary with a key for each option; what a verb has as an argument of its own is none."""
    arguments = {
        parameter.name
        for verb, its in verbs().items()
        if its is kind
        for parameter in inspect.signature(verb).parameters.values()
    }
    lines = [f"class {name_of(kind)}(TypedDict, total=False):"]
    for item in fields(kind):
        if not item.init or item.name in arguments:
            continue
        home = next(one for one in kind.__mro__ if item.name in vars(one).get("__annotations__", {}))
        text = _type(_annotations(home)[item.name], home.__module__, imports)
        option = option_of(item)
        if text != "Any" and option is not None and option.text is not None:
            told = ["str", "Sequence[str]"] if option.text.repeats else ["str"]
            text = " | ".join(
                dict.fromkeys([text.removesuffix(" | None"), *told, *["None"] * text.endswith(" | None")])
            )
        if "Sequence[" in text:
            imports["collections.abc"].add("Sequence")
        lines.append(f"    {item.name}: {text}")
    return "\n".join(lines) + "\n"


def _annotations(kind: type[Any]) -> dict[str, ast.expr]:
    """What stands behind the names in a class, as it is written."""
    (tree,) = ast.parse(inspect.getsource(kind)).body
    assert isinstance(tree, ast.ClassDef)
    return {
        statement.target.id: statement.annotation
        for statement in tree.body
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name)
    }


def _type(node: ast.expr, module: str, imports: defaultdict[str, set[str]]) -> str:
    """The type of an annotation, without what is said about its option, its names imported."""
    if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and node.value.id == "Annotated":
        assert isinstance(node.slice, ast.Tuple)
        return _type(node.slice.elts[0], module, imports)
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return _type(ast.parse(node.value, mode="eval").body, module, imports)
    for one in ast.walk(node):
        if isinstance(one, ast.Name):
            home = _home(one.id, module)
            if home:
                imports[home].add(one.id)
    text = ast.unparse(node)
    # Lists serve wherever a tuple of any length does.
    return re.sub(r"^tuple\[(.*), \.\.\.\]$", r"Sequence[\1]", text)


def _home(name: str, module: str) -> str:
    """The module that has a name which another one uses; empty for what Python knows."""
    tree = ast.parse(Path(importlib.import_module(module).__file__ or "").read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and any(alias.name == name for alias in node.names):
            return node.module or ""
    return module if hasattr(importlib.import_module(module), name) else ""


if __name__ == "__main__":
    STUB.write_text(written(), encoding="utf-8")

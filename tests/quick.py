"""The tests of what changed: ``make quick`` runs what this prints, in about a minute.

Who needs whom is read from the files, and nothing is imported: imports of modules and inside of functions, names by the
face that lists them (``from rotorid import identify`` needs the module of ``identify``), modules named in strings
(``"rotorid.io.px4.log"``), and modules that a table loads by their names (``f"rotorid.cli.{name}"``).

A test file is nearest where it is named after a changed module (``tests/unit/PACKAGE/test_MODULE.py``), then where it
imports one, then where it imports what imports one, and so on; of those that are as near, first what has the same words
in its name. The nearest run, as far as :data:`BUDGET_S` allows by ``tests/durations.json``. Doctests of changed modules
run too. The others are left to ``make test``, with studies of real flights, twins, browsers and the site
(:data:`LONG`); the nearest of them are listed.

``python -m tests.quick --renew REPORT`` writes the durations of a report that ``pytest --junitxml REPORT`` wrote.
"""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

from tests.sources import SOURCE, no_collection, parts, syntax

ROOT = Path(__file__).resolve().parents[1]
LONG = (
    *(f"tests/{folder}/" for folder in ("agreement", "browser", "peers", "reference", "twins")),
    *(f"tests/docs/test_{what}.py" for what in ("package", "site", "tutorials")),
)
BUDGET_S = 45.0
"""Of what is chosen, one file after the other: two cores need half of it, and some seconds to begin."""
SHORT_S = 0.5
"""Of a file that is not in the table."""
LISTED = 12
"""Of what is left out: who wants all runs ``make test``."""
DURATIONS = "tests/durations.json"
ELSE = "tests/api/test_faces.py"
"""What runs where no test belongs to the change."""

_DOTTED = re.compile(r"\brotorid(?:\.[A-Za-z_]\w*)+")


@dataclass(frozen=True)
class File:
    """What a Python file needs.

    Attributes
    ----------
    path
        Relative to the repository.
    names
        Dotted names that it imports, with the attributes that it takes of them, and that its strings contain.
    tables
        Packages whose modules it loads by names that are known when it runs only.
    words
        Its strings, without those that are documentation.
    slow
        Whether ``make study`` alone runs its tests.
    """

    path: str
    names: frozenset[str]
    tables: frozenset[str]
    words: frozenset[str]
    slow: bool

    @property
    def is_test(self) -> bool:
        return self.path.startswith("tests/") and Path(self.path).name.startswith("test_")


@dataclass(frozen=True)
class Choice:
    """Test files of a change, nearest first, and those for which there is no time, studies of flights among them."""

    chosen: tuple[str, ...]
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class Tree:
    """The Python files of a repository.

    Attributes
    ----------
    files
        By module.
    faces
        Package to its public names and their modules, by ``__init__.pyi``.
    durations_s
        Of test files by their paths, where they are not :data:`SHORT_S`.
    """

    files: Mapping[str, File]
    faces: Mapping[str, Mapping[str, str]]
    durations_s: Mapping[str, float]

    def homes(self, name: str) -> Iterator[str]:
        """Modules that a dotted name needs: what is imported, and through the faces what defines it."""
        words = name.split(".")
        for size in range(len(words), 0, -1):
            module = ".".join(words[:size])
            if module in self.files:
                yield module
                home = self.faces.get(module, {}).get(words[size]) if size < len(words) else None
                if home is not None and home != module:
                    yield from self.homes(f"{home}.{words[size]}")
                return

    @cached_property
    def imports(self) -> Mapping[str, frozenset[str]]:
        """Module to the modules that it needs itself."""
        children: dict[str, set[str]] = {}
        for module in self.files:
            children.setdefault(module.rpartition(".")[0], set()).add(module)
        found = {
            module: {home for name in file.names for home in self.homes(name)}.union(
                *(children.get(package, ()) for package in file.tables)
            )
            for module, file in self.files.items()
        }
        for module, file in self.files.items():
            package = module.rpartition(".")[0]
            if package.startswith("rotorid."):
                found[module].add(package)
            if file.path.startswith("tests/"):
                folders = module.split(".")[:-1]
                above = {".".join([*folders[:size], "conftest"]) for size in range(1, len(folders) + 1)}
                # What is asked by name of a table that is near: rotorid("identify", ...) needs rotorid.cli.identify.
                near = distances(found, {module}, within=4)
                asked = {
                    f"{package}.{word}" for one in near for package in self.files[one].tables for word in file.words
                }
                found[module] |= (above | asked) & self.files.keys()
        return {module: frozenset(needed - {module}) for module, needed in found.items()}

    @cached_property
    def importers(self) -> Mapping[str, set[str]]:
        """Module to the modules that need it."""
        found: dict[str, set[str]] = {module: set() for module in self.files}
        for module, needed in self.imports.items():
            for name in needed:
                found[name].add(module)
        return found

    @cached_property
    def mirrors(self) -> Mapping[str, str | None]:
        """Test file to the module that it is named after."""
        return {module: mirrored(file.path, self.files) for module, file in self.files.items() if file.is_test}

    def changed_with(self, path: str) -> set[str]:
        """Modules that change with a file: itself, its package, or those that name a file or a folder of data."""
        if path.endswith((".py", ".pyi")):
            return {module for module, file in self.files.items() if file.path == path.removesuffix("i")}
        for name in path.split("/")[: -3 if path.startswith("src/") else -2 : -1]:
            named = {module for module, file in self.files.items() if any(name in one.split("/") for one in file.words)}
            if named:
                return named
        return set()

    def choose(self, changed: Iterable[str], *, budget_s: float = BUDGET_S) -> Choice:
        """Test files of changed files, nearest first, as far as the budget allows.

        Parameters
        ----------
        changed
            Paths, relative to the repository.
        budget_s
            How long the chosen files may take, one after the other.
        """
        paths = set(changed)
        modules = {module for path in paths for module in self.changed_with(path)}
        near = {module: 1 + distance for module, distance in distances(self.importers, modules).items()}
        near |= {module: 1 for module, named in self.mirrors.items() if named in modules}
        near |= {module: 0 for module in modules if self.files[module].path in paths}
        words = {word for path in paths for word in _words(path)}
        tests = [
            (near[module], -len(words & _words(self.files[module].path)), cost_s, module)
            for module, cost_s in self.routine_s.items()
            if module in near
        ]
        chosen: list[str] = []
        left_out: list[str] = []
        spent_s = 0.0
        for _, _, cost_s, module in sorted(tests):
            file = self.files[module]
            fits = not chosen or spent_s + cost_s <= budget_s
            if fits and (not near[module] or not file.path.startswith(LONG)):
                chosen.append(file.path)
                spent_s += cost_s
            else:
                left_out.append(file.path)
        return Choice(tuple(chosen), tuple(left_out))

    @cached_property
    def routine_s(self) -> Mapping[str, float]:
        """Test file that ``make test`` runs to how long its tests take."""
        return {
            module: self.durations_s.get(file.path, SHORT_S)
            for module, file in self.files.items()
            if file.is_test and not file.slow
        }


def distances(graph: Mapping[str, Iterable[str]], start: Iterable[str], *, within: int | None = None) -> dict[str, int]:
    """Nodes that are reached, and in how many steps.

    Examples
    --------
    >>> distances({"a": "b", "b": "c", "c": ""}, ["a"], within=1)
    {'a': 0, 'b': 1}
    """
    found = dict.fromkeys(start, 0)
    edge, steps = list(found), 0
    while edge and (within is None or steps < within):
        steps += 1
        edge = list(dict.fromkeys(name for one in edge for name in graph[one] if name not in found))
        found.update(dict.fromkeys(edge, steps))
    return found


def mirrored(path: str, modules: Iterable[str]) -> str | None:
    """The module that a unit test is named after: the one of the longest name.

    Examples
    --------
    >>> mirrored("tests/unit/io/px4/test_log_damage.py", ["rotorid.io.px4.log", "rotorid.io.log"])
    'rotorid.io.px4.log'
    """
    match = re.fullmatch(r"tests/unit/(.+/)?test_(\w+)\.py", path)
    if match is None:
        return None
    package, words = f"rotorid.{(match[1] or '').replace('/', '.')}", match[2].split("_")
    names = (package + "_".join(words[:size]) for size in range(len(words), 0, -1))
    return next((name for name in names if name in modules), None)


@cache
def _words(path: str) -> frozenset[str]:
    """Words of a path, without those that all have."""
    return frozenset(re.split(r"[/_.]", path)) - {"src", "rotorid", "tests", "unit", "test", "py"}


def read(path: Path, root: Path) -> File:
    """A Python file below a root."""
    # Other tests read the package too, and have its trees.
    tree = syntax(path) if path.is_relative_to(SOURCE) else ast.parse(path.read_text(encoding="utf-8"))
    nodes = list(_running(tree))
    bound: dict[str, str | None] = {}
    names: set[str] = set()
    tables: set[str] = set()
    words: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
            bound |= {alias.asname or alias.name.partition(".")[0]: alias.asname and alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
            bound |= {alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.JoinedStr) and isinstance(node.values[0], ast.Constant):
            begin = _DOTTED.fullmatch(str(node.values[0].value).removesuffix("."))
            tables |= {begin[0]} if begin and len(node.values) > 1 else set()
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            words.add(node.value)
        elif isinstance(node, ast.List | ast.Tuple):
            values = [str(one.value) if isinstance(one, ast.Constant) else "" for one in node.elts]
            names |= {f"{name}.__main__" for flag, name in pairwise(values) if flag == "-m"}
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "pytestmark":
            words |= {"pytestmark slow"} if "mark.slow" in ast.unparse(node.value) else set()
    for node in nodes:
        if isinstance(node, ast.Attribute):
            first, rest = _attributes(node)
            names |= {f"{bound[first] or first}.{rest}"} if first in bound else set()
    names.update(name for word in words if "rotorid." in word for name in _DOTTED.findall(word))
    return File(
        path.relative_to(root).as_posix(),
        frozenset(names),
        frozenset(tables),
        frozenset(words),
        slow="pytestmark slow" in words,
    )


def _running(node: ast.AST) -> Iterator[ast.AST]:
    """Parts of a program that run: neither documentation nor what a type checker alone reads."""
    rest = [node]
    while rest:
        one = rest.pop()
        for_types = isinstance(one, ast.If) and isinstance(one.test, ast.Name) and one.test.id == "TYPE_CHECKING"
        documents = isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant)
        if not (for_types or documents):
            yield one
            rest.extend(parts(one))


def _attributes(node: ast.expr) -> tuple[str, str]:
    """``a.b.c`` as ``a`` and ``b.c``; nothing where that is no chain of names."""
    names: list[str] = []
    while isinstance(node, ast.Attribute):
        names.append(node.attr)
        node = node.value
    return (node.id, ".".join(reversed(names))) if isinstance(node, ast.Name) else ("", "")


@cache
def read_tree(root: Path = ROOT) -> Tree:
    """The repository as it is, read once."""
    files, faces = {}, {}
    for folder in (root / "src", root):
        for path in sorted(one for top in ("rotorid", "tests", "benchmarks") for one in (folder / top).rglob("*.py")):
            names = path.relative_to(folder).with_suffix("").parts
            module = ".".join(names[:-1] if names[-1] == "__init__" else names)
            with no_collection():
                files[module] = read(path, root)
            face = path.with_suffix(".pyi")
            if face.exists():
                lines = (line.split() for line in face.read_text(encoding="utf-8").splitlines())
                faces[module] = {words[-1]: words[1] for words in lines if words[:1] == ["from"]}
    table = root / DURATIONS
    return Tree(files, faces, json.loads(table.read_text(encoding="utf-8")) if table.exists() else {})


def changed_since(base: str) -> list[str]:
    """Files that differ from a commit, or that git does not know yet."""
    calls = ("git", "diff", "--name-only", base), ("git", "ls-files", "--others", "--exclude-standard")
    lines = (subprocess.run(call, cwd=ROOT, check=True, capture_output=True, text=True).stdout for call in calls)
    return [name for text in lines for name in text.splitlines()]


def durations_of(report: Path) -> dict[str, float]:
    """Seconds of each file that takes longer than :data:`SHORT_S`, by a report of pytest in the format of JUnit."""
    found: dict[str, float] = {}
    for case in ElementTree.parse(report).iter("testcase"):
        path = case.get("classname", "").replace(".", "/") + ".py"
        found[path] = found.get(path, 0.0) + float(case.get("time", "0"))
    return {
        path: round(found[path], 1) for path in sorted(found) if path.startswith("tests/") and found[path] > SHORT_S
    }


def main(words: list[str]) -> None:
    """Print test files and modules with doctests, as pytest takes them; and what is left out, as remarks."""
    if words[:1] == ["--renew"]:
        table = durations_of(Path(words[1]))
        (ROOT / DURATIONS).write_text(f"{json.dumps(table, indent=1)}\n", encoding="utf-8")
        return
    changed = changed_since(words[0] if words else "HEAD")
    choice = read_tree().choose(changed)
    modules = [path for path in changed if path.startswith("src/") and path.endswith(".py") and (ROOT / path).exists()]
    print(*(choice.chosen or (ELSE,)), *(path for path in modules if ">>>" in (ROOT / path).read_text("utf-8")))
    if choice.left_out:
        more = len(choice.left_out) - LISTED
        others = [f"and {more} more"] if more > 0 else []
        print("Left to make test, nearest first:", *choice.left_out[:LISTED], *others, sep="\n  ", file=sys.stderr)


if __name__ == "__main__":
    main(sys.argv[1:])

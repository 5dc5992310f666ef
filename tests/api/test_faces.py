"""Every package has a face: what its ``__init__.pyi`` lists is there, is no module, and stays so whatever is loaded."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import rotorid
from rotorid._faces import deprecated

SOURCE = Path(rotorid.__file__).parent
STUBS = sorted(SOURCE.rglob("__init__.pyi"))
PACKAGES = [".".join(stub.parent.relative_to(SOURCE.parent).parts) for stub in STUBS]
VERBS = (
    *("bode", "bounds", "compare", "delay", "design", "find_excitations", "fit", "frequency_response", "identify"),
    *("inspect", "load", "read", "reduce", "resample", "response", "save", "simulate", "verify"),
)
BELOW = {"rotorid.signal": "rotorid.autopilots", "rotorid.tuning": "rotorid.models.autopilots"}
"""Whose names stay public where they were, although autopilots, which lie below, need them as well."""

MOST_MODULES = 3
"""Of the package, that ``import rotorid`` loads; all others are loaded when a name of theirs is used."""


DEPRECATED = [(package, name, words) for package in PACKAGES for name, words in deprecated(package).items()]
DEPRECATION = re.compile(r"deprecated, removed in (\d+)\.(\d+)(?:: use (rotorid(?:\.\w+)*)\.(\w+))?")


def listed(package: str) -> dict[str, str]:
    """Name to home, by the stub, of the names that stay."""
    path = SOURCE.parent.joinpath(*package.split("."), "__init__.pyi")
    lines = [node for node in ast.parse(path.read_text("utf-8")).body if isinstance(node, ast.ImportFrom)]
    for node in lines:
        assert node.level == 0
        assert [name.asname for name in node.names] == [node.names[0].name], "one import a line, `NAME as NAME`"
    homes = {node.names[0].name: str(node.module) for node in lines}
    return {name: home for name, home in homes.items() if name not in deprecated(package)}


def homes_of(name: str) -> list[str]:
    """Modules that define a name, for a message that helps whoever moved it."""
    defined = []
    for path in SOURCE.rglob("*.py"):
        for node in ast.parse(path.read_text("utf-8")).body:
            targets = [t.id for t in getattr(node, "targets", []) if isinstance(t, ast.Name)]
            if name in {getattr(node, "name", None), *targets}:
                defined.append(".".join(path.relative_to(SOURCE.parent).with_suffix("").parts))
    return defined


@pytest.fixture(scope="module")
def everything_loaded() -> None:
    """Every module of the package, as a long session has them."""
    for module in pkgutil.walk_packages(rotorid.__path__, "rotorid."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)


def test_names_of_the_old_package_say_where_they_are() -> None:
    import rotorid.pipeline
    from rotorid.flying import design

    vars(rotorid.pipeline).pop("design", None)
    with pytest.warns(DeprecationWarning, match=r"removed in 0\.3: use rotorid\.flying\.design$"):
        assert rotorid.pipeline.design is design
    assert vars(rotorid.pipeline)["__all__"] == []


@pytest.mark.parametrize("package", PACKAGES)
def test_every_listed_name_exists(package: str) -> None:
    names = listed(package)
    assert importlib.import_module(package).__all__ == sorted(names)
    for name, home in names.items():
        module = importlib.import_module(home)
        there = home == package or hasattr(module, name)
        assert there, f"{package} lists {name} of {home}; it is defined in {homes_of(name)}"
        assert home == package or home.startswith((f"{package}.", f"{BELOW.get(package, package)}."))


@pytest.mark.parametrize("package", PACKAGES)
def test_no_module_hides_a_name_of_a_face(package: str, everything_loaded: None) -> None:
    face = importlib.import_module(package)
    for name, home in listed(package).items():
        assert isinstance(getattr(face, name), ModuleType) == (home == package), f"{package}.{name} is a module"
        assert name in dir(face)


def test_every_verb_of_the_readme_is_one(everything_loaded: None) -> None:
    for verb in VERBS:
        assert callable(getattr(rotorid, verb)), verb
        assert not isinstance(getattr(rotorid, verb), ModuleType), verb


def test_every_package_has_a_face() -> None:
    packages = {".".join(path.parent.relative_to(SOURCE.parent).parts) for path in SOURCE.rglob("__init__.py")}
    rooms = {
        package
        for package in packages
        if package.startswith(("rotorid.autopilots.", "rotorid.fitting.", "rotorid.fits."))
    }
    # What these rooms hold are names of the package; commands, their page, their tools, files of plans and the steps
    # of ``identify`` are no library.
    inner = {"rotorid.checking", "rotorid.cli", "rotorid.fits", "rotorid.lab", "rotorid.mcp", "rotorid.plans"}
    assert packages - rooms - set(PACKAGES) <= inner | {f"rotorid.io.{room}" for room in ("betaflight", "ros")}


def test_an_unknown_name_of_a_face_is_an_attribute_error() -> None:
    import rotorid.spectral

    with pytest.raises(AttributeError, match="no attribute 'frequency_respones'"):
        _ = rotorid.spectral.frequency_respones  # type: ignore[attr-defined]


@pytest.mark.parametrize(("package", "name", "words"), DEPRECATED, ids=lambda word: str(word).partition(",")[0])
def test_a_deprecated_name_works_until_its_release(package: str, name: str, words: str) -> None:
    match = DEPRECATION.fullmatch(words)
    assert match, f"{package}.{name}: `# deprecated, removed in X.Y: use rotorid.PACKAGE.NAME`"
    assert (int(match[1]), int(match[2])) > tuple(map(int, rotorid.__version__.split(".")[:2])), "remove it now"
    face = importlib.import_module(package)
    assert name not in face.__all__
    vars(face).pop(name, None)
    with pytest.warns(DeprecationWarning, match=re.escape(f"{package}.{name} is {words}")):
        assert getattr(face, name) is not None
    if match[3]:
        assert match[4] in importlib.import_module(match[3]).__all__


def test_a_deprecated_name_warns_whoever_takes_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "aging"
    folder.mkdir()
    (folder / "__init__.py").write_text(
        "from rotorid._faces import lazy\n\n__getattr__, __dir__, __all__ = lazy(__name__)\n"
    )
    (folder / "__init__.pyi").write_text(
        "from rotorid.errors import LogError as LogError\n"
        "# deprecated, removed in 9.9\nfrom rotorid.errors import UsageError as UsageError\n\n"
        "# deprecated, removed in 9.9: use aging.LogError\nReadError = LogError\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    face = importlib.import_module("aging")
    assert face.__all__ == ["LogError"]
    assert face.LogError is rotorid.LogError
    assert deprecated("aging") == {
        "ReadError": "deprecated, removed in 9.9: use aging.LogError",
        "UsageError": "deprecated, removed in 9.9",
    }
    taken: dict[str, object] = {}
    with pytest.warns(DeprecationWarning, match=r"aging\.ReadError is .*use aging\.LogError") as caught:
        exec("from aging import ReadError\nfrom aging import ReadError", taken)
    assert [warning.filename for warning in caught] == ["<string>"], "once, at the line that takes it"
    assert taken["ReadError"] is rotorid.LogError
    with pytest.warns(DeprecationWarning, match=r"aging\.UsageError is deprecated, removed in 9\.9$") as caught:
        assert face.UsageError is rotorid.UsageError
    assert [warning.filename for warning in caught] == [__file__]


def test_import_brings_nothing_heavy() -> None:
    code = "import sys; before = set(sys.modules); import rotorid; print(*sorted(set(sys.modules) - before))"
    brought = set(subprocess.check_output([sys.executable, "-c", code], text=True).split())
    assert {name.split(".")[0] for name in brought}.isdisjoint({"numpy", "scipy", "numba", "pydantic", "rich", "typer"})
    assert sum(name.startswith("rotorid") for name in brought) <= MOST_MODULES

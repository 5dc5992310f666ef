"""What is shipped: wheel and source, licenses, the man page, and a Dockerfile whose steps work."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
from tests.docs.man_page import PLACE, man_page

from rotorid import __version__
from rotorid.cli.installation import CORE, EXTRAS, NEWEST, OLDEST

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
LARGEST_WHEEL_B = 8 << 20


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("build", reason="build is not installed")
    pytest.importorskip("hatchling", reason="hatchling is not installed")
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True, timeout=300)
    return folder


@pytest.fixture(scope="module")
def wheel(built: Path) -> Path:
    return next(built.glob("*.whl"))


def test_the_wheel_holds_the_package_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as packed:
        held = {name for name in packed.namelist() if ".dist-info/" not in name and ".data/" not in name}
        man = [name for name in packed.namelist() if name.endswith("share/man/man1/rotorid.1")]
    source = ROOT / "src"
    there = {
        file.relative_to(source).as_posix()
        for file in (source / "rotorid").rglob("*")
        if file.is_file() and "__pycache__" not in file.parts
    }
    assert held == there
    assert man
    assert wheel.stat().st_size < LARGEST_WHEEL_B


def test_the_license_of_everything_vendored_goes_along(wheel: Path) -> None:
    vendored = {file.parent for file in (ROOT / "src").rglob("vendor/*") if file.suffix != ".py"}
    licensed = {(ROOT / place).parent for place in PROJECT["project"]["license-files"][1:]}
    assert vendored == licensed
    with zipfile.ZipFile(wheel) as packed:
        held = [name for name in packed.namelist() if ".dist-info/licenses/" in name]
    assert len(held) == len(PROJECT["project"]["license-files"])


def test_the_source_builds_and_tests_itself(built: Path) -> None:
    with tarfile.open(next(built.glob("*.tar.gz"))) as packed:
        names = {name.partition("/")[2] for name in packed.getnames()}
    assert {"pyproject.toml", "Makefile", "tests/conftest.py", "docs/method.md", "CITATION.cff"} <= names
    assert not [name for name in names if name.endswith((".ulg", ".BIN", ".bbl", ".mat", ".pyc"))]


def test_the_index_will_show_it(built: Path) -> None:
    pytest.importorskip("twine", reason="twine is not installed")
    files = [str(file) for file in sorted(built.iterdir())]
    checked = subprocess.run(
        [sys.executable, "-m", "twine", "check", "--strict", *files], capture_output=True, text=True, check=False
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_versions_and_extras_are_said_alike_everywhere() -> None:
    project = PROJECT["project"]
    assert project["version"] == __version__
    assert f"version: {__version__}" in (ROOT / "CITATION.cff").read_text("utf-8")
    assert project["requires-python"] == f">={OLDEST[0]}.{OLDEST[1]},<{NEWEST[0]}.{NEWEST[1] + 1}"
    assert {re.split(r"[>=]", one)[0] for one in project["dependencies"]} == set(CORE)
    extras = {name: brought for name, brought in project["optional-dependencies"].items() if name != "all"}
    assert {name: tuple(re.split(r"[>=]", one)[0] for one in brought) for name, brought in extras.items()} == EXTRAS
    (everything,) = project["optional-dependencies"]["all"]
    assert set(re.findall(r"[\w-]+", everything.partition("[")[2])) == set(extras) - {"docs"}


def test_the_man_page_is_of_today() -> None:
    assert PLACE.read_text("utf-8") == man_page(), "renew it with `python -m tests.docs.man_page`"


@pytest.mark.slow
def test_a_fresh_installation_is_sound(wheel: Path, tmp_path: Path) -> None:
    """What the Dockerfile does, step by step, without a container: a new environment, the wheel, the doctor."""
    place = tmp_path / "venv"
    venv.create(place, with_pip=True)
    program = place / "bin"
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    subprocess.run([program / "pip", "install", "--quiet", wheel], check=True, env=environment, timeout=600)
    checked = subprocess.run(
        [program / "rotorid", "doctor"], check=False, env=environment, capture_output=True, text=True, cwd=tmp_path
    )
    assert checked.returncode == 0, checked.stdout
    assert "pip install 'rotorid[lab]'" in checked.stdout


def test_the_dockerfile_names_what_there_is() -> None:
    steps = (ROOT / "Dockerfile").read_text("utf-8")
    (extras,) = re.findall(r"'/src\[([\w,]+)\]'", steps)
    assert set(extras.split(",")) <= set(EXTRAS)
    assert re.search(r"python:3\.(\d+)-slim", steps)
    assert 'ENTRYPOINT ["rotorid"]' in steps

"""What is installed and run is what was tried: bounds, hashes, and the license of all that is bundled."""

from __future__ import annotations

import hashlib
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
VENDORED = ROOT / "src" / "rotorid" / "plot" / "vendor"
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def test_every_dependency_has_a_lower_and_an_upper_bound() -> None:
    extras = PROJECT["optional-dependencies"]
    # Tools of the documentation do not reach a user; `all` lists the extras of rotorid itself.
    brought = {one for extra, packages in extras.items() if extra not in ("docs", "all") for one in packages}
    for requirement in {*PROJECT["dependencies"], *brought}:
        assert re.fullmatch(r"[\w-]+>=[\d.]+,<[\d.]+", requirement), requirement


def test_every_locked_package_has_a_hash() -> None:
    packages = tomllib.loads((ROOT / "uv.lock").read_text("utf-8"))["package"]
    registered = [package for package in packages if "registry" in package["source"]]
    assert len(registered) > 100
    for package in registered:
        files = [*package.get("wheels", []), *([package["sdist"]] if "sdist" in package else [])]
        assert files
        assert all(file["hash"].startswith("sha256:") for file in files), package["name"]


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda file: file.stem)
def test_every_action_is_named_by_hash_and_version(workflow: Path) -> None:
    text = workflow.read_text("utf-8")
    actions = re.findall(r"uses: (.*)", text)
    assert actions
    for action in actions:
        assert re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", action), action
    assert "\npermissions:" in text, "a workflow says which rights it has"


def test_the_base_image_is_named_by_hash() -> None:
    assert re.search(r"^FROM python:3\.\d+-slim@sha256:[0-9a-f]{64}$", (ROOT / "Dockerfile").read_text("utf-8"), re.M)


def test_known_holes_are_looked_for_on_each_change() -> None:
    assert "pip-audit==" in (ROOT / ".github" / "workflows" / "ci.yml").read_text("utf-8")


def test_the_licenses_of_the_bundle_are_those_of_this_plotly() -> None:
    """Another plotly.js needs its packages and licenses listed again."""
    text = (VENDORED / "LICENSE.bundled").read_text("utf-8")
    plotly = (VENDORED / "plotly-basic.min.js").read_bytes()
    assert hashlib.sha256(plotly).hexdigest() in text
    (version,) = re.findall(rb"plotly\.js \(basic - minified\) v([\d.]+)", plotly)
    assert f"plotly.js {version.decode()}" in text
    packages = re.findall(r"^=+\n(\S+) [\d.]+ \((.+)\)\n=+$", text, re.M)
    assert len(packages) == 22
    assert {license_name for _, license_name in packages} <= {"MIT", "BSD-3-Clause", "Zlib"}
    # What the file itself says that it bundles.
    said = re.findall(rb"^(\S+?)/\S+:\n  \(\*", plotly[plotly.index(b"Bundled license information") :], re.M)
    assert {name.decode() for name in said} <= {name for name, _ in packages}

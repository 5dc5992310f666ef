"""One flight and one result for all tests of the command line."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.unit.cli import once
from tests.unit.cli.commands import ROLL, Ran, fly_roll_sweeps, rotorid

from rotorid.identifying.identification import identify
from rotorid.io.registry import read
from rotorid.results.model import IdentifiedModel
from rotorid.settings.identifying import IdentifySettings


@pytest.fixture(scope="session")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    log = tmp_path_factory.mktemp("flight") / "sweeps.csv"
    fly_roll_sweeps(log)
    return log


@pytest.fixture(scope="session")
def by_api(flight: Path) -> IdentifiedModel:
    """What the Python API answers."""
    return identify([read(flight)], "rate.roll", settings=IdentifySettings(band_rad_s=(12.0, 50.0)))


@pytest.fixture(scope="session")
def results(flight: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Ran]:
    """What ``rotorid identify --json`` wrote and said; the folder did not exist before."""
    folder = tmp_path_factory.mktemp("results") / "made" / "here"
    with once.computed_once():
        return folder, rotorid("identify", flight, *ROLL, "--out", folder, "--json")


@pytest.fixture(scope="module")
def computed_once() -> Iterator[None]:
    """Commands of a module answer the same question once."""
    with once.computed_once():
        yield

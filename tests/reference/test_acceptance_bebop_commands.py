"""Paper 5 from the command line, on the flights of its authors: table I, and positions of whole flights."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from rotorid.cli.app import app

MAPPINGS = Path(__file__).resolve().parents[2] / "docs" / "mappings"
FITTED = ("120935", "121028", "121250")
UNSEEN = "122633"

# Published mean and spread over the records, 1/s (paper 5, table I).
PUBLISHED_DRAG = {"k_Dx": (0.25, 0.08), "k_Dy": (0.33, 0.05)}


def run(*words: str | Path) -> None:
    done = CliRunner().invoke(app, [*map(str, words), "--quiet"], catch_exceptions=False)
    assert done.exit_code == 0, done.output


def identified(shared_data: Path, folder: Path, *known: str) -> Path:
    """The whole vehicle by the flights of the authors."""
    logs = [shared_data / "bebop" / "ident" / f"{name}.mat" for name in FITTED]
    mapping = ("--map", MAPPINGS / "bebop_flight.toml")
    run("identify", *logs, *mapping, "--model", "flight.first_order", *known, "--out", folder)
    return folder


@pytest.mark.slow
def test_drag_of_table_1_in_one_command(shared_data: Path, tmp_path: Path) -> None:
    logs = sorted((shared_data / "bebop" / "steadystate").glob("20Hz_*.mat"))
    run("identify", *logs, "--map", MAPPINGS / "bebop_drag.toml", "--model", "drag.linear", "--out", tmp_path / "d")
    result = json.loads((tmp_path / "d" / "result.json").read_text())
    for name, (mean, spread) in PUBLISHED_DRAG.items():
        found = result["parameters"][name]
        assert abs(found["value"] - mean) < spread
        # What records say alone scatters as the paper's do, and the interval knows it.
        assert 0.5 * spread < found["std"] < 3.0 * spread
        alone = [one["parameters"][name]["value"] for one in result["records"] if name in one["parameters"]]
        assert len(alone) > 1


@pytest.fixture(scope="module")
def flown(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An unseen flight beside its simulation, with the drag of steady flight as published.

    With the drag that the fitted flights show by themselves, 29 % of the velocities are explained.
    """
    folder = tmp_path_factory.mktemp("flown")
    flight = identified(shared_data, folder / "f", "--fix", "k_Dx=0.25", "--fix", "k_Dy=0.33")
    log = shared_data / "bebop" / "ident" / f"{UNSEEN}.mat"
    mapping = ("--map", MAPPINGS / "bebop_flight.toml")
    run("simulate", flight, "--log", log, *mapping, "--tables", "csv", "--out", folder / "flown")
    return folder / "flown"


def scores_of(flown: Path) -> dict[str, float]:
    (one,) = json.loads((flown / "flown.json").read_text())["flights"]
    return {name: score["nrmse_fit_percent"] for name, score in one["scores"].items()}


@pytest.mark.slow
@pytest.mark.xfail(
    strict=True,
    raises=AssertionError,
    reason="69 %: drag of steady flight; the bar was set with one that was fitted to the drift of whole flights",
)
def test_the_way_north_is_explained(flown: Path) -> None:
    north = scores_of(flown)["north"]
    if north < 65.0:
        pytest.fail(f"beyond what is known: {north}")
    assert north > 70.0


@pytest.mark.slow
def test_whole_flights_are_flown_beside_the_measurement(flown: Path) -> None:
    scores = scores_of(flown)
    assert np.mean([scores[name] for name in ("phi", "theta", "velocity_down")]) > 77.5
    assert np.mean([scores[name] for name in ("velocity_north", "velocity_east")]) > 70.0
    with np.load(flown / "flown.npz") as signals:
        lower, upper, simulated = (signals[f"flight_1/{kind}"] for kind in ("lower", "upper", "simulated"))
    assert ((lower <= simulated) & (simulated <= upper)).all()
    assert (flown / "tables" / "flown.csv").read_text().count("\n") == len(scores) + 1


@pytest.mark.slow
@pytest.mark.xfail(
    strict=True,
    raises=AssertionError,
    reason="k_Dy 0.05 ± 0.12 in pieces of 3 s, where tilts explain the motion worst: 0.28 in pieces of 6 s, 0.39 "
    "without; an angle that is late by tau takes tau omega^2 from drag, more in quicker motion",
)
def test_the_parameters_lie_where_the_paper_has_them(shared_data: Path, tmp_path: Path) -> None:
    found = json.loads((identified(shared_data, tmp_path / "f") / "result.json").read_text())["parameters"]
    for name, (mean, spread) in PUBLISHED_DRAG.items():
        if abs(found[name]["value"] - mean) > 2.5 * np.hypot(spread, found[name]["std"]):
            pytest.fail(f"beyond what is known: {found[name]}")
    for name, (mean, spread) in PUBLISHED_DRAG.items():
        assert abs(found[name]["value"] - mean) < 2.0 * np.hypot(spread, found[name]["std"])
    assert found["K_psi"]["status"] == "fixed"

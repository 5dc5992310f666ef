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


@pytest.fixture(scope="module")
def flight(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    logs = [shared_data / "bebop" / "ident" / f"{name}.mat" for name in FITTED]
    run(
        "identify",
        *logs,
        "--map",
        MAPPINGS / "bebop_flight.toml",
        "--model",
        "flight.first_order",
        "--out",
        folder / "f",
    )
    return folder / "f"


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


@pytest.mark.slow
def test_whole_flights_are_flown_beside_the_measurement(flight: Path, shared_data: Path, tmp_path: Path) -> None:
    log = shared_data / "bebop" / "ident" / f"{UNSEEN}.mat"
    mapping = ("--map", MAPPINGS / "bebop_flight.toml")
    run("simulate", flight, "--log", log, *mapping, "--tables", "csv", "--out", tmp_path / "flown")
    flown = json.loads((tmp_path / "flown" / "flown.json").read_text())
    (one,) = flown["flights"]
    scores = {name: score["nrmse_fit_percent"] for name, score in one["scores"].items()}
    assert np.mean([scores[name] for name in ("phi", "theta", "velocity_down")]) > 77.5
    assert np.mean([scores[name] for name in ("velocity_north", "velocity_east")]) > 70.0
    assert scores["north"] > 70.0
    with np.load(tmp_path / "flown" / "flown.npz") as signals:
        lower, upper, simulated = (signals[f"flight_1/{kind}"] for kind in ("lower", "upper", "simulated"))
    assert ((lower <= simulated) & (simulated <= upper)).all()
    assert (tmp_path / "flown" / "tables" / "flown.csv").read_text().count("\n") == len(scores) + 1


@pytest.mark.slow
def test_the_parameters_lie_where_the_paper_has_them(flight: Path) -> None:
    found = json.loads((flight / "result.json").read_text())["parameters"]
    for name, (mean, spread) in PUBLISHED_DRAG.items():
        assert abs(found[name]["value"] - mean) < 2.0 * np.hypot(spread, found[name]["std"])
    assert found["K_psi"]["status"] == "fixed"

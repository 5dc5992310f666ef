"""Force and moment of flights that are known exactly: the right model has no error, others exactly theirs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.unit.benchmarking.made_flights import NETWORK_MISSES_N, SAMPLES, neurobem_folder

from rotorid.benchmarking import loads
from rotorid.benchmarking.catalog import BENCHMARKS
from rotorid.benchmarking.flights import BenchFlight, folds, read_flights, vehicle_of
from rotorid.benchmarking.foreign import foreign_predictions
from rotorid.benchmarking.scores import BenchRow
from rotorid.errors import UsageError

FILTERED_N = 1e-3
"""What the filter of 9 Hz takes of a thrust that changes by 1 N at 1 Hz: (1/9)⁴ of it, squared."""

HERE = "tests.unit.benchmarking.made_flights"


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> tuple[BenchFlight, ...]:
    folder = neurobem_folder(tmp_path_factory.mktemp("bench"))
    return read_flights(BENCHMARKS["neurobem"], folder, sandbox=False).flights


def table(
    flights: tuple[BenchFlight, ...], monkeypatch: pytest.MonkeyPatch, predictions: str | None = None
) -> dict[str, dict[str, BenchRow]]:
    """Rows by model and metric, without the long fits."""
    monkeypatch.setattr(loads, "_of_rotorid", lambda *_: [])
    foreign = foreign_predictions(predictions) if predictions else None
    _, parts = folds(BENCHMARKS["neurobem"], flights)
    rows = loads.load_table(flights, parts, vehicle_of("neurobem"), foreign)
    return {
        model: {row.metric: row for row in rows if row.model == model} for model in dict.fromkeys(r.model for r in rows)
    }


def test_rows_of_known_flights(flights: tuple[BenchFlight, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    rows = table(flights, monkeypatch)
    naive = rows["thrust by speed alone, no moment"]
    assert naive["force"].value < FILTERED_N
    assert naive["moment"].value == pytest.approx(2.52e-3 * 0.2 * (2 * np.pi * 0.4) ** 2 / np.sqrt(2), rel=0.05)
    network = rows["NeuroBEM's network"]
    assert network["force"].value == pytest.approx(NETWORK_MISSES_N, rel=1e-5)
    assert network["force_z"].value < FILTERED_N
    assert network["moment"].value < 0.02 * naive["moment"].value
    assert list(naive) == ["force", "force_xy", "force_z", "moment", "moment_xy", "moment_z"]


def test_a_function_learns_from_the_other_flights(
    flights: tuple[BenchFlight, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = table(flights, monkeypatch, f"{HERE}:thrust_by_speed")["thrust_by_speed"]
    assert rows["force"].value < FILTERED_N
    assert rows["force"].source == f"Python function thrust_by_speed of {HERE}"
    assert rows["moment"].value < 1e-5


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("fails", r"fails failed on \w+ \(ZeroDivisionError: "),
        ("no_number", rf"no_number gave {6 * SAMPLES} values for \w+ that are no numbers"),
        ("too_short", rf"too_short gave an array of shape \(6,\) for \w+; expected \(6, {SAMPLES}\)"),
    ],
)
def test_a_function_with_a_fault_is_named(
    flights: tuple[BenchFlight, ...], monkeypatch: pytest.MonkeyPatch, name: str, words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        table(flights, monkeypatch, f"{HERE}:{name}")


def predictions(path: Path, flights: tuple[BenchFlight, ...], *, shift: float = 0.0) -> Path:
    """A file with the true force along z, shifted, and no moment."""
    lines = ["flight," + ",".join(f"{name} [N]" for name in loads.COLUMNS)]
    for flight in reversed(flights):
        for force in 0.752 * flight.record.force.T:
            lines.append(f"{flight.name},0,0,{force[2] + shift:.9f},0,0,0")  # noqa: PERF401
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_file_of_predictions_in_any_order_of_flights(
    flights: tuple[BenchFlight, ...], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path = predictions(tmp_path / "mine.csv", flights, shift=0.25)
    rows = table(flights, monkeypatch, str(path))["mine"]
    assert rows["force_z"].value == pytest.approx(0.25, abs=FILTERED_N)
    assert rows["force_z"].source == "predictions in mine.csv"


def test_without_columns_of_the_network_there_is_no_row_of_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    folder = neurobem_folder(tmp_path, columns=29)
    flights = read_flights(BENCHMARKS["neurobem"], folder, sandbox=False).flights
    assert list(table(flights, monkeypatch)) == ["thrust by speed alone, no moment", "differentiator over 10 ms"]

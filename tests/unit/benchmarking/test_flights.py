"""Flights of a folder: by their names, with their hashes, and what is said where there are none."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.unit.benchmarking.made_flights import neurobem_folder

import rotorid.benchmarking.flights as module
from rotorid.benchmarking.catalog import BENCHMARKS, benchmark_named
from rotorid.benchmarking.flights import BenchFlight, files_of, folds, read_flights
from rotorid.errors import InsufficientDataError, UsageError

DOCS = Path(__file__).resolve().parents[3] / "docs"
SOURCE = Path(__file__).resolve().parents[3] / "src" / "rotorid" / "benchmarking" / "mappings"


@pytest.mark.parametrize("path", sorted(SOURCE.glob("*.toml")), ids=lambda path: path.name)
def test_mappings_are_those_of_the_docs(path: Path) -> None:
    assert path.read_bytes() == (DOCS / "mappings" / path.name).read_bytes()


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_missing_folder_says_where_to_get_the_data(name: str, tmp_path: Path) -> None:
    for folder, words in ((tmp_path / "none", "there is no folder"), (tmp_path, "contains no flight of")):
        with pytest.raises(UsageError, match=words) as error:
            files_of(BENCHMARKS[name], folder)
        assert BENCHMARKS[name].address in str(error.value)
        assert BENCHMARKS[name].license in str(error.value)


def test_files_are_known_by_their_names(tmp_path: Path) -> None:
    (tmp_path / "train").mkdir()
    for name in ("square_20251017_run1.csv", "train/idsia_random1_20251017_run4.parquet.xz", "notes.csv", "x.parquet"):
        (tmp_path / name).write_bytes(b"")
    assert list(files_of(BENCHMARKS["idsia"], tmp_path)) == ["random1_20251017_run4", "square_20251017_run1"]
    (tmp_path / "train" / "square_20251017_run1.parquet").write_bytes(b"")
    with pytest.raises(UsageError, match=r"square_20251017_run1 is in .* twice"):
        files_of(BENCHMARKS["idsia"], tmp_path)


def test_the_authors_split_counts_where_both_parts_are_there() -> None:
    def named(*names: str) -> list[BenchFlight]:
        return [BenchFlight.__new__(BenchFlight) for _ in names]

    def split(*names: str) -> tuple[str, list[tuple[list[int], list[int]]]]:
        flights = named(*names)
        for flight, name in zip(flights, names, strict=True):
            object.__setattr__(flight, "name", name)
        return folds(BENCHMARKS["idsia"], flights)

    assert split("melon_1", "square_1", "square_2")[1] == [([1, 2], [0])]
    assert split("square_1", "square_2")[1] == [([1], [0]), ([0], [1])]
    words, parts = split(*(f"square_{number}" for number in range(11)))
    assert words == "11 flights in 5 groups, each by a fit of the others"
    assert sorted(place for _, predicted in parts for place in predicted) == list(range(11))
    assert all(not set(fitted) & set(predicted) for fitted, predicted in parts)


def test_a_file_that_is_not_the_published_one_is_named(tmp_path: Path) -> None:
    folder = neurobem_folder(tmp_path)
    (folder / "bemnn20210223104800seg1.mat").rename(folder / "neurobem_20210223104803seg2.mat")
    found = read_flights(BENCHMARKS["neurobem"], folder, sandbox=False)
    assert [finding.where for finding in found.findings] == [flight.name for flight in found.flights]
    messages = [finding.message for finding in found.findings]
    assert "may differ from the published file: its hash is not known" in messages[0]
    assert "20210223104803seg2 differs from the published file" in messages[1]


def test_flights_that_are_shorter_than_a_prediction_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def read(name: str, path: Path, sandbox: bool) -> list[BenchFlight]:
        flight = BenchFlight.__new__(BenchFlight)
        object.__setattr__(flight, "record", SimpleNamespace(samples=50))
        return [flight]

    monkeypatch.setitem(module._READ, "idsia", read)
    (tmp_path / "square_20251017_run1.csv").write_bytes(b"")
    with pytest.raises(InsufficientDataError, match="contains 0 usable flights of idsia") as error:
        read_flights(BENCHMARKS["idsia"], tmp_path)
    (finding,) = error.value.findings
    assert "50 of its samples are usable; this needs more than 50." in finding.message


def test_one_flight_is_too_few(tmp_path: Path) -> None:
    with pytest.raises(InsufficientDataError, match="contains 1 usable flight of neurobem; this needs two or more"):
        read_flights(BENCHMARKS["neurobem"], neurobem_folder(tmp_path, flights=1), sandbox=False)


def test_a_name_is_suggested() -> None:
    with pytest.raises(UsageError, match="did you mean idsia"):
        benchmark_named("nano-drone")
    with pytest.raises(UsageError, match="did you mean neurobem"):
        benchmark_named("neurobm")

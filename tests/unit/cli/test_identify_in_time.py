"""``rotorid identify`` in time: files, streams and exit codes are those of every other model."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from tests.unit.checking.response_flight import TRUTH, flight
from tests.unit.cli.commands import rotorid

from rotorid.io.tables.csv import write_csv
from rotorid.settings.resolve import resolve_model


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("flights")
    paths = folder / "first.csv", folder / "second.csv"
    for seed, path in enumerate(paths):
        (topic,) = flight(seed=seed, samples=800).topics
        columns = dict(zip((channel.name for channel in topic.channels), topic.values, strict=True))
        write_csv(path, topic.time_s, columns)
    return paths


def test_the_four_files_and_one_object(logs: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    ran = rotorid(
        *("identify", logs[0], "--model", "response.second_order_delay"),
        *("--verify", logs[1], "--out", out, "--json", "--quiet"),
    )
    assert ran.code == 0, ran.err
    document = json.loads(ran.out)
    assert document["method"] == "output_error"
    assert document["fit_percent"]["phi"] > 85.0
    assert document["parameters"].keys() == TRUTH.keys()
    assert {path.name for path in out.iterdir()} == {"result.json", "responses.npz", "report.html", "model.toml"}
    with np.load(out / "responses.npz", allow_pickle=False) as arrays:
        assert arrays["record_0_measured"].shape == arrays["record_0_simulated"].shape == (1, 800)
    again = resolve_model(out / "model.toml")
    assert again.parameters["K_phi"].value == pytest.approx(document["parameters"]["K_phi"]["value"])
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Measured and simulated" in page
    assert "Comparison with the fit in the frequency domain" in page


def test_a_person_sees_how_much_is_explained(logs: tuple[Path, Path], tmp_path: Path) -> None:
    ran = rotorid(
        *("identify", *logs, "--model", "response.first_order_delay", "--cross-validate", "each"),
        *("--out", tmp_path / "out"),
    )
    assert ran.code == 0, ran.err
    assert "output error, zero-order hold; explained: phi" in ran.out
    assert "cross-validated on other records" in ran.out
    assert "Cross-validation" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


def test_a_log_without_set_points_ends_with_one_and_the_finding(logs: tuple[Path, Path], tmp_path: Path) -> None:
    (topic,) = flight(samples=400).topics
    write_csv(tmp_path / "bare.csv", topic.time_s, {"phi": topic.values[1]})
    ran = rotorid(
        "identify", tmp_path / "bare.csv", "--model", "response.first_order", "--json", "--out", tmp_path / "o"
    )
    assert ran.code == 1
    assert "missing_channel" in {finding["kind"] for finding in json.loads(ran.out)["findings"]}
    assert not (tmp_path / "o").exists()
    del logs


@pytest.mark.parametrize(
    "wrong",
    [
        ("--method", "guess"),
        ("--hold", "second"),
        ("--starts", "many"),
        ("--pieces", "0"),
        ("--cross-validate", "all"),
        ("--method", "frequency", "--hold", "zero"),
        ("--method", "frequency", "--starts", "sobol:4"),
    ],
)
def test_wrong_use_ends_with_two(wrong: tuple[str, str], logs: tuple[Path, Path], tmp_path: Path) -> None:
    ran = rotorid("identify", logs[0], "--model", "response.first_order", *wrong, "--out", tmp_path / "o", "--quiet")
    assert (ran.code, ran.out) == (2, "")
    assert not (tmp_path / "o").exists()

"""``bench neurobem`` on the three flights at hand: the numbers of models, of the network and of a differentiator."""

from __future__ import annotations

from pathlib import Path

import pytest

from rotorid.benchmarking import bench
from rotorid.benchmarking.benchmark import Benchmarked

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def found(shared_data: Path) -> Benchmarked:
    return bench("neurobem", shared_data / "flight")


@pytest.mark.parametrize(
    ("model", "force_n", "moment_mnm"),
    [
        ("physical.flight", 0.489, 18.4),
        ("physical.flight --predictor", 0.489, 18.1),
        ("thrust by speed alone, no moment", 1.264, 24.3),
        ("NeuroBEM's network", 0.308, 8.7),
        ("differentiator over 10 ms", 0.116, 5.9),
    ],
)
def test_errors_of_three_flights(found: Benchmarked, model: str, force_n: float, moment_mnm: float) -> None:
    """Behind the filters of the data; without them the network has 0.32 N and 9.2 mN m."""
    values = {row.metric: row.value for row in found.rows if row.model == model}
    assert values["force"] == pytest.approx(force_n, abs=0.005)
    assert 1e3 * values["moment"] == pytest.approx(moment_mnm, abs=0.1)


def test_every_file_is_the_published_one(found: Benchmarked) -> None:
    assert not found.findings
    assert found.split == "each of 3 flights by a fit of the others"


def test_deviations_are_those_between_flights(found: Benchmarked) -> None:
    """Of three flights of so different speeds they are a third of the error."""
    assert all(row.std is not None and 0.1 * row.value < row.std < row.value for row in found.rows)

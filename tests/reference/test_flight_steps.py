"""Many steps ahead on public flights of a quadrotor of 45 g: each run predicted by a fit of the four others.

The errors are those of IDSIA's benchmark: mean norms of position, velocity, attitude and rates after 1 to 50 steps of
10 ms from every sample, summed over the steps, over those of a state that is kept. The runs are those at hand that
have motors in step, not the benchmark's own test runs, on which the best published models reach 0.13, 0.27, 0.62 and
1.0. No number is fitted to these errors. Positions are integrals of the logged velocity, because the logged position
differs from them by 10 to 15 % of its change over 50 steps, whatever the model.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from rotorid.benchmarking import bench
from rotorid.benchmarking.benchmark import Benchmarked

pytestmark = pytest.mark.slow

RUNS = (
    "multisine_20251017_run3",
    "random1_20251017_run4",
    "random2_20251017_run2",
    "square_20251017_run1",
    "square_20251017_run3",
)

BARS = {"position": 0.13, "velocity": 0.27, "attitude": 0.62, "rates": 1.0}
VEHICLE = {"position": 0.18, "velocity": 0.53, "attitude": 0.92, "rates": 0.89}
PREDICTOR = {"position": 0.145, "velocity": 0.43, "attitude": 0.79, "rates": 0.72}
"""What was reached, and a sixth more."""

OURS = {"vehicle": "physical.flight", "predictor": "physical.flight --predictor"}


@pytest.fixture(scope="module")
def found(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Benchmarked:
    """The benchmark on the five runs, from a folder of their own."""
    folder = tmp_path_factory.mktemp("idsia")
    for name in RUNS:
        (folder / f"idsia_{name}.parquet.xz").symlink_to(shared_data / "flight" / f"idsia_{name}.parquet.xz")
    return bench("idsia", folder)


@pytest.fixture(scope="module")
def unseen(found: Benchmarked) -> dict[str, dict[str, float]]:
    """Ratios of the vehicle and of the predictor, positions against the integral of the logged velocity."""
    ratios = {kind: {row.metric: row.value for row in found.rows if row.model == name} for kind, name in OURS.items()}
    return {kind: {**values, "position": values["displacement"]} for kind, values in ratios.items()}


def test_every_file_is_the_published_one(found: Benchmarked) -> None:
    assert found.flights == RUNS
    assert not found.findings


def test_the_kept_state_and_published_errors_are_in_the_table(found: Benchmarked) -> None:
    values = {(row.model, row.metric): row.value for row in found.rows}
    assert values["state kept", "rates"] == 1.0
    assert values["best published, of each quantity", "position"] == BARS["position"]
    assert found.steps["physical.flight"].horizons_s.size == 50


@pytest.mark.parametrize(("kind", "reached"), [("vehicle", VEHICLE), ("predictor", PREDICTOR)])
def test_steps_ahead_are_predicted_as_well_as_before(
    unseen: dict[str, dict[str, float]], kind: str, reached: dict[str, float]
) -> None:
    ratios = unseen[kind]
    assert {name: ratios[name] for name in BARS if ratios[name] > reached[name]} == {}


def test_rates_are_predicted_better_than_by_keeping_them(unseen: dict[str, dict[str, float]]) -> None:
    assert all(unseen[kind]["rates"] < BARS["rates"] for kind in unseen)


def test_positions_are_predicted_as_well_as_by_the_best_published_model(unseen: dict[str, dict[str, float]]) -> None:
    """0.123 of the predictor."""
    assert unseen["predictor"]["position"] <= BARS["position"]


@pytest.mark.xfail(
    raises=AssertionError,
    strict=True,
    reason="0.37 of 0.27 in velocity, all of it by attitude (0.14 with the true one), and 0.68 of 0.62 in attitude: "
    "moments below 1 Hz follow airspeed 40 to 90 ms late, which no inflow of momentum theory does",
)
def test_steps_ahead_are_predicted_as_well_as_by_the_best_published_models(unseen: dict[str, dict[str, float]]) -> None:
    ratios = unseen["predictor"]
    assert {name: ratios[name] for name, bar in BARS.items() if ratios[name] > bar} == {}

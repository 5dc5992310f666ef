"""A pitch test bed with published polynomial models: their errors, and those of our own."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.fitting.black_box.polynomial import PolynomialModel, PolynomialOrders, fit_polynomial_output_error
from rotorid.fitting.time.output_error import TimeData

MAPPING = Path(__file__).resolve().parents[2] / "docs" / "mappings" / "pitch_rig_two_files.toml"
RATE_HZ = 5.0
OUTPUT_ERROR = PolynomialModel.given(
    [1.0, -2.0798, 1.5923, -1.0809, 0.85391, -0.2781], [[0.0, 0.0, -0.17999, 0.65694, -0.47025]]
)
ARX = PolynomialModel.given([1.0, -1.9551, 0.64593, 0.70572, -0.41605, 0.025549], [[0.0, 0.0, 0.27464, -0.26442]])
PRINTED = {"output error": (54.6866, 49.5952, 74.6829), "ARX": (68.191, 63.8589, 86.9643)}
# The coefficients are printed to five digits; with poles close to one that is 0.2 % of the variance of the error.
PRINTED_TO = 0.002


@pytest.fixture(scope="module")
def experiments(shared_data: Path) -> list[TimeData]:
    (topic,) = rotorid.read(shared_data / "polimi" / "input.mat", mapping=MAPPING).topics
    edges = np.flatnonzero(np.diff(topic.time_s, prepend=-np.inf, append=np.inf) > 1.5 / RATE_HZ)
    return [
        TimeData(
            name=f"experiment {number}",
            inputs=topic.values[:1, start:stop],
            outputs=topic.values[1:, start:stop],
            sample_rate_hz=RATE_HZ,
        )
        for number, (start, stop) in enumerate(pairwise(edges), start=1)
    ]


def variance(model: PolynomialModel, record: TimeData) -> float:
    """Of the error of the simulation from rest, about its mean."""
    return float(np.var(record.outputs[0] - model.simulate(record.inputs), ddof=1))


@pytest.mark.parametrize(("name", "model"), [("output error", OUTPUT_ERROR), ("ARX", ARX)])
def test_printed_models_have_their_printed_errors(
    name: str, model: PolynomialModel, experiments: list[TimeData]
) -> None:
    found = [variance(model, record) for record in experiments]
    assert found == pytest.approx(PRINTED[name], rel=PRINTED_TO)


def test_own_output_error_model_is_no_worse_on_what_it_has_not_seen(experiments: list[TimeData]) -> None:
    orders = PolynomialOrders(denominator=5, numerators=(3,), delays=(2,))
    # The variance is judged about the mean, so the fit leaves the mean of the error free as well.
    model = fit_polynomial_output_error(experiments[:1], orders, offset=True)
    found = [variance(model, record) for record in experiments]
    assert found[0] <= variance(OUTPUT_ERROR, experiments[0])
    for own, printed in zip(found[1:], PRINTED["output error"][1:], strict=True):
        assert own <= printed * (1.0 + PRINTED_TO)
    # Nor do the coefficients differ by more than their own standard deviation.
    moved = model.denominator[1:] - OUTPUT_ERROR.denominator[1:]
    assert np.all(np.abs(moved) < np.sqrt(np.diag(model.covariance))[:5])

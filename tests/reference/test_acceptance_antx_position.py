"""Position of the quadrotor on its rail: two excitations, each of which predicts the other."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import rotorid
from rotorid.fitting.time.output_error import TimeData, TimeProblem, fit_output_error
from rotorid.models.library import response_model
from rotorid.verification.fixed_parameters import FixedParameterScores, cross_validate, score_frozen

STRETCHES = {"sweep.mat": (132.9, 158.0), "prbs.mat": (50.0, 76.0)}
RATE_HZ = 100.0
MODEL = response_model("response.second_order", [("north_setpoint", "north")])


def stretch(shared_data: Path, name: str) -> TimeData:
    """Set-point and position at the rate of the slower one."""
    log = rotorid.read(shared_data / "antx" / name, mapping=shared_data / "antx" / "map.toml")
    start_s, stop_s = STRETCHES[name]
    time_s = np.arange(start_s, stop_s, 1.0 / RATE_HZ)
    rows = [
        np.interp(time_s, topic.time_s, topic.values[row])
        for topic, row in (next(log.holding(channel)) for channel in ("north_setpoint", "north"))
    ]
    return TimeData(name=name, inputs=rows[0][None], outputs=rows[1][None], sample_rate_hz=RATE_HZ)


def fit(records: tuple[TimeData, ...]) -> dict[str, float]:
    problem = TimeProblem(structure=MODEL, parameters=MODEL.parameters, records=records, hold="first")
    return fit_output_error(problem).parameters.values


def score(values: dict[str, float], one: TimeData) -> list[FixedParameterScores]:
    return [score_frozen(MODEL, values, one)]


def test_each_record_predicts_the_other(shared_data: Path) -> None:
    found = cross_validate(
        [stretch(shared_data, name) for name in STRETCHES], names=list(STRETCHES), kind="each", fit=fit, score=score
    )
    from_sweep, from_prbs = found.table[0, 1], found.table[1, 0]
    print(f"sweep predicts PRBS {from_sweep:.1f} %, PRBS predicts sweep {from_prbs:.1f} %")
    assert from_sweep >= 88.0
    assert from_prbs >= 86.0

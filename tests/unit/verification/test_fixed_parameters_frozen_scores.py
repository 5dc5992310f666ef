"""Scores of frozen models: only what no model can know is estimated."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.time.output_error import TimeData
from rotorid.models.equations import structure_from_equations
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.simulation.linear import discretize
from rotorid.simulation.linear_kernels import recursion
from rotorid.typing import FloatArray
from rotorid.verification.fixed_parameters import natural_horizon_s, score_frozen

RATE_HZ, SAMPLES = 50.0, 600
VALUES = {"K": 2.0, "a": -3.0}


def lag(a: float = -3.0) -> LinearStructure:
    return structure_from_equations(
        name="lag",
        inputs=["u"],
        states=["x"],
        equations=["x' = a*x + K*u"],
        outputs=["x"],
        parameters=ParameterSet([Parameter(name="K", value=2.0, unit="1/s"), Parameter(name="a", value=a, unit="1/s")]),
    )


def command() -> FloatArray:
    return np.repeat(np.sign(np.random.default_rng(3).standard_normal(SAMPLES // 25)), 25)[None]


def flown(a: float = -3.0, *, start: float = 0.7, shift: float = 0.0) -> TimeData:
    u = command()
    step = discretize(np.array([[a]]), np.array([[2.0]]), delays_s=np.zeros(1), step_s=1.0 / RATE_HZ, hold="zero")
    states = recursion(step.transition, step.forcing(u, u[:, 0]), np.array([start]))
    return TimeData(name="twin", inputs=u, outputs=states.T + shift, sample_rate_hz=RATE_HZ)


def test_the_true_model_explains_everything_from_any_start() -> None:
    scored = score_frozen(lag(), VALUES, flown(shift=0.3), hold="zero")
    assert scored.scores["x"].nrmse_fit_percent == pytest.approx(100.0, abs=1e-9)
    assert scored.scores["x"].rms < 1e-11
    assert math.isinf(scored.horizon_s)
    assert scored.time_s[-1] == pytest.approx((SAMPLES - 1) / RATE_HZ)


def test_a_shift_that_is_not_estimated_counts_as_error() -> None:
    scored = score_frozen(lag(), VALUES, flown(shift=0.3), hold="zero", unknowns=("initial_state",))
    # The start takes a little of it over one time constant.
    assert 0.25 < scored.scores["x"].rms < 0.3


def test_parameters_are_not_touched() -> None:
    half = score_frozen(lag(), {"K": 1.0, "a": -3.0}, flown(), hold="zero")
    assert half.scores["x"].nrmse_fit_percent == pytest.approx(50.0, abs=5.0)


def test_the_mean_is_over_the_outputs() -> None:
    scored = score_frozen(lag(), VALUES, flown(), hold="zero")
    assert scored.mean_fit_percent == scored.scores["x"].nrmse_fit_percent


def test_an_unstable_model_is_predicted_ahead() -> None:
    grows, values = lag(0.8), {"K": 2.0, "a": 0.8}
    assert natural_horizon_s(grows, values, 12.0) == 0.5
    scored = score_frozen(grows, values, flown(0.8))
    assert scored.horizon_s == 0.5
    assert scored.measured.shape == scored.predicted.shape
    assert scored.scores["x"].nrmse_fit_percent > 95.0


def test_a_stable_model_can_be_predicted_ahead_too() -> None:
    scored = score_frozen(lag(), VALUES, flown(), horizon_s=0.25)
    assert scored.horizon_s == 0.25
    assert natural_horizon_s(lag(), VALUES, 12.0) == math.inf


def test_a_short_record_cannot_be_predicted_ahead() -> None:
    whole = flown(0.8)
    short = TimeData(name="s", inputs=whole.inputs[:, :20], outputs=whole.outputs[:, :20], sample_rate_hz=RATE_HZ)
    with pytest.raises(InsufficientDataError, match="ahead"):
        score_frozen(lag(), VALUES, short, horizon_s=0.5)


def test_rows_must_be_those_of_the_model() -> None:
    wrong = TimeData(name="w", inputs=np.zeros((2, 30)), outputs=np.zeros((1, 30)), sample_rate_hz=RATE_HZ)
    with pytest.raises(UsageError, match="2 inputs"):
        score_frozen(lag(), VALUES, wrong)

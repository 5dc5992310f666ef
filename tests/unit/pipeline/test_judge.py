"""Remarks and refusals: where a number would say more than the data do."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from rotorid.errors import InsufficientDataError
from rotorid.models.library import library_model, rate_model
from rotorid.models.parameter import ParameterSet
from rotorid.pipeline.fits.frequency import _pushed_on_by_speed, judge_parameters, require_known_gain
from rotorid.uncertainty.cramer_rao import Bounds

FOUND = rate_model("rate.roll").parameters
"""L_roll 100, L_p -1, T_motor 0.03, tau_roll 0.01."""


def spread(parameters: ParameterSet, percent: float, *, correlation: float = 0.0) -> Bounds:
    """The same relative uncertainty for all free parameters; lag and delay correlated."""
    std = np.array([abs(parameters[name].value) for name in parameters.free]) * percent / 100.0
    covariance = np.diag(std**2)
    lag, delay = parameters.free.index("T_motor"), parameters.free.index("tau_roll")
    covariance[lag, delay] = covariance[delay, lag] = correlation * std[lag] * std[delay]
    return Bounds(
        names=parameters.free,
        cramer_rao=2.0 * std,
        insensitivity=std,
        covariance=covariance,
        random=covariance,
        inflation=1.0,
    )


def test_a_gain_within_two_standard_deviations_of_zero_is_refused() -> None:
    require_known_gain("L_roll", FOUND, spread(FOUND, 49.0))
    with pytest.raises(InsufficientDataError, match=r"do not show L_roll: 1e\+02 ± 5e\+01 rad/s\^2") as refused:
        require_known_gain("L_roll", FOUND, spread(FOUND, 51.0))
    (finding,) = refused.value.findings
    assert (finding.kind, finding.where) == ("not_identifiable", "L_roll")


def test_a_gain_that_was_fixed_is_not_judged() -> None:
    held = FOUND.fix("L_roll", 100.0)
    require_known_gain("L_roll", held, spread(held, 90.0))
    require_known_gain(None, FOUND, spread(FOUND, 90.0))


@pytest.mark.parametrize(
    ("percent", "kinds"),
    [(4.0, set()), (11.0, {"insensitive_parameter"}), (9.99, set())],
    ids=["certain", "insensitive", "at the guideline"],
)
def test_guidelines_of_ten_and_twenty_percent(percent: float, kinds: set[str]) -> None:
    remarks = judge_parameters(FOUND, spread(FOUND, percent))
    assert {finding.kind for finding in remarks if finding.severity == "warning"} == kinds


def test_lag_and_delay_that_are_told_apart_say_so() -> None:
    limits = spread(FOUND, 9.0, correlation=-0.8)
    (remark,) = (finding for finding in judge_parameters(FOUND, limits) if finding.kind == "lag_plus_delay")
    assert (remark.severity, remark.numbers["correlation"]) == ("info", pytest.approx(-0.8))


@pytest.mark.parametrize(("percent", "correlation"), [(9.0, -0.99), (30.0, -0.5)], ids=["opposed", "unknown"])
def test_lag_and_delay_that_are_not_told_apart_are_given_as_their_sum(percent: float, correlation: float) -> None:
    remarks = judge_parameters(FOUND, spread(FOUND, percent, correlation=correlation))
    (remark,) = (finding for finding in remarks if finding.kind == "not_identifiable")
    assert remark.severity == "warning"
    assert "Trust their sum of 40.0 ±" in remark.message


def test_lag_and_delay_that_trade_have_a_sum_that_is_known_better() -> None:
    limits = spread(FOUND, 9.0, correlation=-1.0)
    (remark,) = (finding for finding in judge_parameters(FOUND, limits) if finding.kind == "not_identifiable")
    assert remark.numbers["sum_s"] == pytest.approx(0.04, rel=1e-12)
    # Perfectly opposed, the deviations of 2.7 and 0.9 ms subtract.
    assert remark.numbers["std_s"] == pytest.approx(1.8e-3, rel=1e-12)


@pytest.mark.parametrize(("value", "refused"), [(0.09, True), (0.02, False), (-0.2, False)])
def test_a_vehicle_that_its_own_speed_pushes_on_is_refused(value: float, *, refused: bool) -> None:
    model = library_model("axis.roll")
    fitted = SimpleNamespace(
        problem=SimpleNamespace(structure=model),
        parameters=model.parameters.with_values({"Y_v": value}),
        bounds=SimpleNamespace(names=("L_v", "Y_v"), std=np.array([0.3, 0.01])),
    )
    found = list(_pushed_on_by_speed(fitted))  # type: ignore[arg-type]
    assert [(one.kind, one.where) for one in found] == ([("impossible_physics", "Y_v")] if refused else [])
